"""The contents of a report: a frozen value, computed once, that every format renders."""

from __future__ import annotations

from dataclasses import dataclass

from pinholify import __version__
from pinholify.evaluation.summary import Evaluation, OpenCVScore
from pinholify.evaluation.verdict import Verdict, residuals_of
from pinholify.report.board_shape import BoardShape, board_shape_of
from pinholify.report.boards import BoardEntry, boards_of
from pinholify.report.maps import (
    Certainty,
    Coverage,
    ResidualField,
    certainty_of,
    coverage_of,
    residual_field,
    std_over_image,
)
from pinholify.report.model import Model, model_of
from pinholify.report.overview import IntrinsicsSummary, Overview, intrinsics_of, overview_of
from pinholify.report.pictures import Frame, Pictures
from pinholify.report.provenance import Provenance
from pinholify.report.scene import Scene, scene_of
from pinholify.report.straightness import Straightness, straightness_of
from pinholify.report.usage import Snippet, snippets


@dataclass(frozen=True, slots=True)
class Comparison:
    """Errors in px per point of this camera and of OpenCV's ``models`` on the same corners, with equal weights.

    ``heldout_px`` is the error on photographs left out of the fit; None with ``heldout_reason`` if there is none.
    """

    method: str
    heldout_px: float | None
    heldout_reason: str
    kfold_px: float | None
    insample_px: float
    re_percent: float
    models: dict[str, OpenCVScore]


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """A calibration as a report presents it. Lengths in squares or px, angles in degrees.

    ``image_size`` is (width, height) in px, ``board`` the board's description; ``missing`` are sentences on what could
    not be shown and how to get it.
    """

    software: str
    provenance: Provenance
    board: str
    image_size: tuple[int, int]
    overview: Overview
    frames: tuple[Frame, ...]
    intrinsics: IntrinsicsSummary
    boards: tuple[BoardEntry, ...]
    coverage: Coverage
    certainty: Certainty
    residuals: ResidualField
    straightness: Straightness
    scene: Scene
    board_shape: BoardShape | None
    model: Model
    comparison: Comparison
    usage: tuple[Snippet, ...]
    missing: tuple[str, ...]


def make_report(
    evaluation: Evaluation, verdict: Verdict, provenance: Provenance, pictures: Pictures | None = None
) -> Report:
    """The report of an ``evaluation`` of a calibration on its own corners, with the ``verdict`` on it.

    ``pictures`` are its photographs (:func:`~pinholify.report.pictures.read_pictures`); without them the report says
    what is missing. Reads no files.
    """
    calibration = evaluation.calibration
    pictures = Pictures() if pictures is None else pictures
    seen = residuals_of(evaluation, calibration.corner_set)
    residuals = residual_field(calibration, verdict, seen)
    std = std_over_image(calibration.camera)
    return Report(
        f"pinholify {__version__}",
        provenance,
        calibration.corner_set.board.spec,
        calibration.camera.image_size,
        overview_of(evaluation, verdict, residuals.rms_px),
        pictures.frames,
        intrinsics_of(evaluation),
        boards_of(evaluation, verdict, seen, pictures),
        coverage_of(calibration, verdict, seen, std),
        certainty_of(calibration.camera, std),
        residuals,
        straightness_of(evaluation),
        scene_of(evaluation),
        board_shape_of(calibration),
        model_of(evaluation),
        _comparison(evaluation, residuals.rms_px),
        snippets(provenance.file, calibration.camera.image_size),
        tuple(_missing(evaluation, pictures, provenance.file)),
    )


def _comparison(evaluation: Evaluation, insample_px: float) -> Comparison:
    return Comparison(
        evaluation.calibration.method,
        evaluation.heldout.px,
        evaluation.heldout.reason,
        evaluation.kfold_px,
        insample_px,
        evaluation.pooled.re_refined_percent,
        evaluation.opencv,
    )


def _missing(evaluation: Evaluation, pictures: Pictures, file: str) -> list[str]:
    views = evaluation.calibration.corner_set.views
    sentences = []
    if not pictures.thumbnails:
        sentences.append(
            "The photographs were not available, so no straightened picture is shown and boards are drawn without "
            f"their photographs. To include them: pinholify report {file} PHOTOGRAPHS -o report.html."
        )
    elif len(pictures.thumbnails) < len(views):
        names = [view.name for view in views if view.name not in pictures.thumbnails]
        others = f" and {len(names) - 3} more" if len(names) > 3 else ""
        sentences.append(
            f"{len(names)} of the {len(views)} photographs are missing ({', '.join(names[:3])}{others}); "
            "give all of them to include them."
        )
    heldout = evaluation.heldout
    if heldout.px is None:
        remedy = "" if heldout.requested else "; leave out --no-heldout to compute it"
        sentences.append(f"There is no held-out error: {heldout.reason}{remedy}.")
    if evaluation.lines is None:
        sentences.append("The lines of sight are not drawn: they need at least three boards that count.")
    if not evaluation.opencv:
        sentences.append("OpenCV's models were not fitted for comparison; leave out --no-opencv to include them.")
    return sentences
