"""The verdict with its main numbers, and K with its confidence intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.camera import VirtualCamera
from pinholify.evaluation.summary import Evaluation
from pinholify.evaluation.verdict import Verdict, noise_floor, place
from pinholify.evaluation.wrong_corners import sentences
from pinholify.rectification.views import named_view

NORMAL_95 = 1.96  # standard deviations


@dataclass(frozen=True, slots=True)
class Overview:
    """The verdict and its main numbers: errors in px per point, shares as fractions.

    ``sentence`` is the whole verdict; ``headline``, ``reasons`` and ``next_board`` are its parts as in
    :class:`~pinholify.evaluation.verdict.Verdict`, and ``advice`` is the place of ``next_board`` in the image.
    ``insample_px`` weights all corners equally, as the held-out error does. ``floor_px`` is what corner noise alone
    would leave, ``f_share`` the standard deviation of f ÷ f. ``wrong_corners`` of all ``corners`` were left out of
    every number, with the sentences ``wrong_corners_said`` on them.
    """

    level: str
    sentence: str
    headline: str
    reasons: tuple[str, ...]
    next_board: str | None
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
        verdict.headline,
        verdict.reasons,
        verdict.advice,
        calibration.method,
        evaluation.heldout.px,
        evaluation.heldout.reason,
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
    """A length of K in squares with its standard deviation, nan if that is unknown."""

    name: str
    value: float
    std: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % confidence interval, in squares."""
        return self.value - NORMAL_95 * self.std, self.value + NORMAL_95 * self.std


@dataclass(frozen=True, slots=True)
class IntrinsicsSummary:
    """K of the virtual camera, and of the straightened view.

    ``view_focal`` and ``view_centre`` are K of the straightened picture of ``view_size``, in px. ``field_of_view`` is
    that of the whole image, horizontal, vertical and diagonal, in degrees; nan where the camera has no rays. The boards
    disagree ``disagreement`` times as much as noise explains, which all standard deviations include.
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


def intrinsics_of(evaluation: Evaluation) -> IntrinsicsSummary:
    """K of the evaluated camera."""
    calibration = evaluation.calibration
    camera = calibration.camera
    k = camera.intrinsics
    view = named_view(camera)
    lengths = zip(("f", "uc", "vc"), (k.f, k.uc, k.vc), calibration.intrinsics_std, strict=True)
    return IntrinsicsSummary(
        tuple(Length(name, value, float(std)) for name, value, std in lengths),
        calibration.square_mm,
        calibration.reference,
        camera.mirrored,
        float(view.matrix[0, 0]),
        (float(view.matrix[0, 2]), float(view.matrix[1, 2])),
        view.size,
        field_of_view(camera),
        calibration.findings.disagreement,
    )


def field_of_view(camera: VirtualCamera) -> tuple[float, float, float]:
    """Horizontal, vertical and diagonal angle in degrees between opposite ends of the image, by way of its centre."""
    right, bottom = (extent - 1.0 for extent in camera.image_size)
    u, v = right / 2, bottom / 2
    ends = np.array([[[0, v], [right, v]], [[u, 0], [u, bottom]], [[0, 0], [right, bottom]]])
    horizontal, vertical, diagonal = (float(angle) for angle in angles_across(camera, ends, np.array([[u, v]])))
    return horizontal, vertical, diagonal


def angles_across(camera: VirtualCamera, ends: Floats, middle: Floats) -> Floats:
    """Angles (n,) in degrees between the rays of pixels ``ends`` (n, 2, 2) by way of the ray of ``middle`` (1, 2)."""
    directions = camera.to_rays(np.concatenate([middle, ends.reshape(-1, 2)])).directions
    halves = np.degrees(np.arccos(np.clip(directions[1:] @ directions[0], -1.0, 1.0)))
    return np.asarray(halves.reshape(-1, 2).sum(axis=1))
