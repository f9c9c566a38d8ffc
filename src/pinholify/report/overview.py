"""The verdict with the few numbers it rests on, and K with its intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.camera import VirtualCamera
from pinholify.evaluation.summary import Evaluation
from pinholify.evaluation.verdict import Verdict, disagreement, noise_floor, place
from pinholify.evaluation.wrong_corners import sentences
from pinholify.rectification.views import named_view

NORMAL_95 = 1.96  # standard deviations


@dataclass(frozen=True, slots=True)
class Overview:
    """``level`` and ``sentence`` of the verdict; errors in px a point; shares as fractions.

    ``insample_px`` counts every corner alike, as the held-out error does. ``floor_px`` is what the corners' noise alone
    would leave, ``f_share`` the standard deviation of f ÷ f, ``advice`` where in the image one more board would help
    most. ``wrong_corners`` of all ``corners`` were left out of every number; what is said of them is in sentences.
    """

    level: str
    sentence: str
    method: str
    heldout_px: float | None
    heldout_reason: str
    insample_px: float
    floor_px: float
    noise_px: float
    f_share: float
    coverage: float
    boards_used: int
    boards_found: int
    images: int
    advice: str | None
    corners: int
    wrong_corners: int
    wrong_corners_said: tuple[str, ...]


def overview_of(evaluation: Evaluation, verdict: Verdict, insample_px: float) -> Overview:
    """The overview of an ``evaluation`` and its ``verdict``; ``insample_px`` as in :class:`Overview`."""
    calibration = evaluation.calibration
    camera, wrong = calibration.camera, evaluation.wrong
    return Overview(
        verdict.level,
        verdict.sentence,
        calibration.method,
        evaluation.heldout_px,
        evaluation.heldout_reason,
        insample_px,
        noise_floor(evaluation, calibration.corner_set),
        camera.noise_px,
        float(calibration.intrinsics_std[0] / camera.intrinsics.f),
        verdict.coverage,
        sum(board.used for board in evaluation.boards),
        len(calibration.corner_set.found),
        len(evaluation.boards),
        None if verdict.next_board is None else place(verdict.next_board, camera.image_size),
        wrong.found,
        wrong.count,
        sentences(wrong),
    )


@dataclass(frozen=True, slots=True)
class Length:
    """A length of K in squares with its standard deviation; nan where that is unknown."""

    name: str
    value: float
    std: float

    @property
    def interval(self) -> tuple[float, float]:
        """Where the true value lies in 95 of 100 cases, squares."""
        return self.value - NORMAL_95 * self.std, self.value + NORMAL_95 * self.std


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """K of the virtual camera, and the pinhole view that people use.

    ``view_focal`` and ``view_centre`` are K of the straightened picture of ``view_size``, in px. ``field_of_view`` is
    horizontal, vertical and diagonal, in degrees, over the whole image; nan where the camera has no answer. The boards
    pull the camera apart ``disagreement`` times as much as noise explains: all standard deviations count that.
    """

    lengths: tuple[Length, ...]
    square_mm: float | None
    reference: str
    mirrored: bool
    view_focal: float
    view_centre: tuple[float, float]
    view_size: tuple[int, int]
    field_of_view: tuple[float, float, float]
    disagreement: float


def intrinsics_of(evaluation: Evaluation) -> Intrinsics:
    """K of the evaluated camera."""
    calibration = evaluation.calibration
    camera = calibration.camera
    k = camera.intrinsics
    view = named_view(camera, "camera", None, None)
    lengths = zip(("f", "uc", "vc"), (k.f, k.uc, k.vc), calibration.intrinsics_std, strict=True)
    return Intrinsics(
        tuple(Length(name, value, float(std)) for name, value, std in lengths),
        calibration.square_mm,
        calibration.reference,
        camera.mirrored,
        float(view.matrix[0, 0]),
        (float(view.matrix[0, 2]), float(view.matrix[1, 2])),
        view.size,
        field_of_view(camera),
        disagreement(calibration),
    )


def field_of_view(camera: VirtualCamera) -> tuple[float, float, float]:
    """Horizontal, vertical and diagonal angle between the rays of opposite ends of the image, through its middle."""
    right, bottom = (extent - 1.0 for extent in camera.image_size)
    middle = [right / 2, bottom / 2]
    ends = [[0, middle[1]], [right, middle[1]], [middle[0], 0], [middle[0], bottom], [0, 0], [right, bottom]]
    directions = camera.to_rays(np.array([middle, *ends], dtype=np.float64)).directions
    halves: Floats = np.degrees(np.arccos(np.clip(directions[1:] @ directions[0], -1.0, 1.0)))
    horizontal, vertical, diagonal = (float(pair.sum()) for pair in halves.reshape(3, 2))
    return horizontal, vertical, diagonal
