"""The photographs of a calibration: what was found in each, how well it fits, and why it does not count if so."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.calibration.observation import ObservedBoard
from pinholify.calibration.result import Calibration
from pinholify.corners import Corners
from pinholify.evaluation.measures import rms
from pinholify.evaluation.summary import BoardScore, Evaluation
from pinholify.evaluation.verdict import CornerResiduals, Verdict
from pinholify.report.pictures import Picture, Pictures

NOT_FITTED = "it was left out of the fit"


@dataclass(frozen=True, slots=True, eq=False)
class BoardEntry:
    """One photograph of the calibration.

    ``corners`` (n, 2) px with their ``residuals`` (n, 2) px, nan where a corner does not count (``counted`` (n,)).
    The ``dropped`` corners, those of the mask ``wrong`` (n,), were rejected by the fit and are in no number;
    ``crowded`` marks a photograph with far more of them than the others. ``rms_px`` and ``worst_px`` are per point;
    ``ratio`` is the misfit of a suspicious board as a multiple of the noise. ``distance`` in squares is that of the
    board's centre, ``tilt_degrees`` the angle of its normal to the line of sight. ``note`` says how its corners were
    changed.
    """

    name: str
    included: bool
    reason: str
    is_reference: bool
    corners: Floats
    residuals: Floats
    counted: Bools
    wrong: Bools
    dropped: int
    crowded: bool
    rms_px: float | None
    worst_px: float | None
    ce: float | None
    re_percent: float | None
    ratio: float | None
    distance: float | None
    tilt_degrees: float | None
    orientation_assumed: bool
    ambiguous_offset: bool
    note: str
    thumbnail: Picture | None


def boards_of(
    evaluation: Evaluation, verdict: Verdict, seen: CornerResiduals, pictures: Pictures
) -> tuple[BoardEntry, ...]:
    """One entry per photograph, in the order of the views."""
    ratios = {suspicion.name: suspicion.ratio for suspicion in verdict.suspicious}
    views = evaluation.calibration.corner_set.views
    return tuple(
        _entry(evaluation, view, score, seen, ratios.get(view.name), pictures.thumbnails.get(view.name))
        for view, score in zip(views, evaluation.boards, strict=True)
    )


def _entry(
    evaluation: Evaluation,
    view: Corners,
    score: BoardScore,
    seen: CornerResiduals,
    ratio: float | None,
    thumbnail: Picture | None,
) -> BoardEntry:
    calibration = evaluation.calibration
    left_out = calibration.findings.dropped_boards.get(view.name)
    residuals = seen.residuals.get(view.name, np.full((len(view), 2), np.nan))
    counted = seen.inliers.get(view.name, np.zeros(len(view), dtype=bool))
    lengths = np.linalg.norm(residuals[counted], axis=1)
    distance, tilt = _distance_and_tilt(calibration, evaluation.observed.get(view.name))
    return BoardEntry(
        view.name,
        score.used and left_out is None,
        score.reason or (str(left_out) if left_out is not None else "") or ("" if score.used else NOT_FITTED),
        view.name == calibration.reference,
        view.uv,
        residuals,
        counted,
        ~evaluation.wrong.belonging(view),
        score.wrong,
        view.name in evaluation.wrong.crowded,
        rms(residuals[counted]) if len(lengths) else None,
        float(lengths.max()) if len(lengths) else None,
        score.ce,
        score.re_refined_percent,
        ratio,
        distance,
        tilt,
        view.orientation_assumed,
        view.ambiguous_offset,
        calibration.findings.renumbered_boards.get(view.name, ""),
        thumbnail,
    )


def _distance_and_tilt(calibration: Calibration, observed: ObservedBoard | None) -> tuple[float | None, float | None]:
    """Distance of a board's centre in squares, and the angle of its normal to the line of sight in degrees."""
    if observed is None:
        return None, None
    middle = observed.refined.apply(calibration.board_points.mean(axis=0, keepdims=True))[0]
    distance = float(np.linalg.norm(middle))
    cosine = abs(float(observed.refined.rotation[:, 2] @ middle)) / distance
    return distance, float(np.degrees(np.arccos(min(1.0, cosine))))
