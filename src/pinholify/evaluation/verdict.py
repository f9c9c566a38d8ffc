"""The verdict on a calibration: good, fair or poor, the reasons for it, and the tests behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.camera import VirtualCamera
from pinholify.corners import CornerSet
from pinholify.errors import solving
from pinholify.evaluation.shared_error import shared_error_of
from pinholify.evaluation.summary import Evaluation
from pinholify.evaluation.wrong_corners import MANY, TOO_MANY
from pinholify.refinement.diagnosis import (
    BoardSuspicion,
    NextBoard,
    Structure,
    next_board,
    residual_structure,
    suspicious_boards,
)
from pinholify.refinement.sharing import SharedError

POOR_PX, POOR_RATIO = 1.0, 4.0  # held-out error: in px, and as a multiple of what noise alone would leave
FAIR_RATIO = 1.5
USUAL_PX, ROUGH_PX = 0.3, 0.5  # corner noise per axis: the most that is usual, and more than even blur explains
NAMES_SHOWN = 3
POOR_FOCAL = 0.02  # relative standard deviation of f
ENOUGH_COVERAGE = 0.6
STRUCTURED = 0.01  # p-value
ALIKE = 1e-4  # p-value: wrong corners with a common error did not arise by chance but through a fault of the camera
WRONG_RATIO = 2.0  # times the residuals of the other boards
LEAST_TILT_DEG = 5.0  # of a board, that is worth a word
FINEST_PX = 0.03  # per point: corners cannot be located more finely even in perfect pictures, so less means nothing
ROUGH = "(blurred photographs, a bent board, or two cameras?)"
GRID = 64


@dataclass(frozen=True, slots=True, eq=False)
class CornerResiduals:
    """Residuals of an evaluation in the form that :mod:`pinholify.refinement.diagnosis` requires.

    Per view name, ``residuals`` (n, 2) in px and ``inliers`` (n,), the mask of the corners to use. ``noise_px`` is the
    standard deviation of a corner of weight one, per axis.
    """

    residuals: Mapping[str, Floats]
    inliers: Mapping[str, Bools]
    noise_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """``level`` is good, fair or poor.

    ``headline`` gives the held-out error and the uncertainty of f, ``reasons`` are the remarks on them, and ``advice``
    says where to photograph the next board: clauses without a capital or a full stop, of which :attr:`sentence` is
    composed.

    ``structure`` tests the residuals for spatial correlation, ``left_out`` those of the wrong corners, which no measure
    counts; ``shared`` tests for an error that each corner of the board has on every photograph. ``coverage`` is the
    share of the image in the camera's domain, ``suspicious`` are boards whose residuals are too large, and
    ``next_board`` is where one more photograph would help most (joint cameras only).
    """

    level: str
    headline: str
    reasons: tuple[str, ...]
    advice: str | None
    structure: Structure
    coverage: float
    suspicious: tuple[BoardSuspicion, ...]
    next_board: NextBoard | None
    left_out: Structure
    shared: SharedError

    @property
    def sentence(self) -> str:
        """The whole verdict as one sentence: level, headline, reasons and advice."""
        clauses = (self.headline, *self.reasons, *([] if self.advice is None else [self.advice]))
        return f"{self.level.capitalize()}: {'; '.join(clauses)}."


@solving()
def judge(evaluation: Evaluation, corner_set: CornerSet) -> Verdict:
    """The verdict on the ``evaluation`` of a calibration on ``corner_set``."""
    camera = evaluation.calibration.camera
    seen = residuals_of(evaluation, corner_set)
    structure = structure_of(seen, corner_set)
    suspicious = tuple(s for s in suspicious_boards(seen, corner_set) if s.ratio > WRONG_RATIO)
    covered = coverage(camera)
    poses = {name: observed.refined for name, observed in evaluation.observed.items()}
    best = next_board(camera, corner_set.board, poses, weight=corner_set.typical_weight)
    left_out = structure_of(errors_left_out(evaluation, corner_set), corner_set)
    shared = shared_error_of(camera, evaluation.observed.values())
    level, reasons = _level(evaluation, noise_floor(evaluation, corner_set), covered, left_out, suspicious)
    reasons += _remarks(evaluation, structure, shared)
    headline = f"{_held_out(evaluation)}, {_known(evaluation)}"
    advice = None if best is None else f"for the largest gain, photograph the board {place(best, camera.image_size)}"
    return Verdict(level, headline, tuple(reasons), advice, structure, covered, suspicious, best, left_out, shared)


def residuals_of(evaluation: Evaluation, corner_set: CornerSet) -> CornerResiduals:
    """Residuals (n, 2) px of all corners of each counted view; nan (and no inlier) where a corner does not count."""
    residuals, inliers = {}, {}
    for view in corner_set.views:
        observed = evaluation.observed.get(view.name)
        if observed is None:
            continue
        counted = evaluation.wrong.belonging(view)
        counted[counted] = observed.board.inside
        each = np.full((len(view), 2), np.nan)
        each[counted] = observed.residual_px
        residuals[view.name], inliers[view.name] = each, counted & np.isfinite(each).all(axis=1)
    # A board is suspicious only in comparison with the others: where all of them misfit, the camera is at fault.
    typical = [np.sqrt((residuals[n][keep] ** 2).mean()) for n, keep in inliers.items() if keep.any()]
    weight = corner_set.typical_weight
    noise = evaluation.calibration.camera.noise_px / weight
    largest = max([float(np.median(typical or 0.0)), noise, FINEST_PX / np.sqrt(2.0)])
    return CornerResiduals(residuals, inliers, largest * weight)


def structure_of(seen: CornerResiduals, corner_set: CornerSet) -> Structure:
    """Spatial correlation of the residuals; none where no board counts."""
    return residual_structure(seen, corner_set) if seen.residuals else Structure(0.0, 1.0)


def errors_left_out(evaluation: Evaluation, corner_set: CornerSet) -> CornerResiduals:
    """Directions (n, 2) of the errors of the wrong corners of counted views, which chance would make independent.

    Unit vectors divided by the corners' weights, so that the largest errors do not dominate.
    """
    calibration, directions, wrong = evaluation.calibration, {}, {}
    board_points = calibration.points_of(corner_set.board)
    for view in corner_set.views:
        mask, observed = ~evaluation.wrong.belonging(view), evaluation.observed.get(view.name)
        if observed is None or not mask.any():
            continue
        points = observed.refined.apply(board_points[view.ids])
        with np.errstate(all="ignore"):
            error = calibration.camera.project(points) - view.uv
        each = error / np.linalg.norm(error, axis=1, keepdims=True) / view.weights[:, None]
        directions[view.name], wrong[view.name] = each, mask & np.isfinite(each).all(axis=1)
    return CornerResiduals(directions, wrong, 1.0)


def noise_floor(evaluation: Evaluation, corner_set: CornerSet) -> float:
    """The error that corner noise and board motion leave in any camera, px per point.

    It is √2 times the standard deviation of a corner of typical weight.
    """
    weights = np.concatenate([view.weights for view in evaluation.wrong.left_out_of(corner_set).found])
    error = np.hypot(evaluation.calibration.camera.noise_px, evaluation.calibration.findings.motion_px)
    return float(np.sqrt(2.0 * (weights**-2.0).mean()) * error)


def coverage(camera: VirtualCamera) -> float:
    """The share of the image in the domain of ``camera``, where corners count."""
    return float(camera.inside(cell_centres(camera.image_size, GRID, GRID)).mean())


def cell_centres(image_size: tuple[int, int], columns: int, rows: int) -> Floats:
    """Centres (rows × columns, 2) px, row by row, of equal cells that tile an image.

    Pixel centres are integers, so an image of width w spans −0.5 to w − 0.5.
    """
    u, v = (
        (np.arange(count) + 0.5) * extent / count - 0.5
        for extent, count in zip(image_size, (columns, rows), strict=True)
    )
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def place(advice: NextBoard, image_size: tuple[int, int]) -> str:
    """Where ``advice`` is, in words such as ``at the upper left, 40 % of the image wide, tilted by 20°``."""
    width = float(np.ptp(advice.outline[:, 0])) / image_size[0]
    tilt = f", tilted by {round(advice.tilt_deg):d}°" * (advice.tilt_deg >= LEAST_TILT_DEG)
    return f"{_position(advice.outline, image_size)}, {100 * width:.0f} % of the image wide{tilt}"


def _position(outline: Floats, image_size: tuple[int, int]) -> str:
    """Where in the image the ``outline`` (n, 2) px lies, in words such as ``at the upper left``."""
    x, y = outline.mean(axis=0) / image_size
    column = "left" if x < 0.4 else "right" if x > 0.6 else ""
    row = "upper" if y < 0.4 else "lower" if y > 0.6 else ""
    names = {("", ""): "in the middle", ("", "upper"): "at the top", ("", "lower"): "at the bottom"}
    if not column:
        return names["", row]
    return f"at the {row} {column}" if row else f"at the {column}"


def _level(
    evaluation: Evaluation,
    floor: float,
    covered: float,
    left_out: Structure,
    suspicious: tuple[BoardSuspicion, ...],
) -> tuple[str, list[str]]:
    """The level and the reasons for it.

    A large ``floor`` excuses no error: beyond usual corner noise it is misfit that the solve took for noise.
    """
    heldout = evaluation.heldout
    unknown = heldout.px is None and heldout.requested
    error = evaluation.pooled.re_px if heldout.px is None else heldout.px
    noise = floor / np.sqrt(2.0)
    off = error > max(POOR_PX, POOR_RATIO * np.sqrt(2.0) * min(noise, USUAL_PX))
    known = _imported(evaluation) or _focal(evaluation) < POOR_FOCAL
    alike = left_out.p_value < ALIKE
    hidden = evaluation.wrong.share > (MANY if alike else TOO_MANY)
    reasons = []
    if error > FAIR_RATIO * max(floor, FINEST_PX):
        alone = "noise and board motion" if evaluation.calibration.findings.motion_px > 0.0 else "noise"
        reasons.append(f"corner {alone} alone would leave {floor:.2f} px")
    best = _best_of_opencv(evaluation)
    if not np.isfinite(floor) and error > FAIR_RATIO * max(best, FINEST_PX):
        reasons.append(f"the best of OpenCV's models fits these photographs with an error of {best:.2f} px")
    if noise > ROUGH_PX:
        reasons.append(f"corner noise is {noise:.2g} px per axis, where {USUAL_PX:g} px or less is usual {ROUGH}")
    if covered < ENOUGH_COVERAGE:
        reasons.append(f"boards cover only {100 * covered:.0f} % of the image")
    if evaluation.calibration.findings.too_few_boards:
        reasons.append(
            f"the boards {_of_its_own(evaluation)}disagree, through motion or an uneven board: a few more photographs "
            "would show which"
        )
    if suspicious:
        reasons.append(f"suspicious boards: {_listed([s.name for s in suspicious])}")
    if evaluation.wrong.crowded:
        reasons.append(f"boards with too many wrong corners: {_listed(evaluation.wrong.crowded)}")
    if alike:
        reasons.append(
            f"the wrong corners share a common error (p = {left_out.p_value:.1g}): the camera model may be at fault"
        )
    level = "poor" if unknown or off or not known or hidden else "fair" if reasons else "good"
    return level, reasons


def _best_of_opencv(evaluation: Evaluation) -> float:
    """The smallest error in sample: the yardstick for a camera whose corner noise is unknown; inf if there is none."""
    return min((s.insample_px for s in evaluation.opencv.values() if s.insample_px is not None), default=np.inf)


def _listed(names: Sequence[str]) -> str:
    more = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")


def _remarks(evaluation: Evaluation, structure: Structure, shared: SharedError) -> list[str]:
    """Remarks that do not affect the level."""
    remarks = []
    if evaluation.wrong.share > MANY:
        remarks.append(_left_out(evaluation))
    if structure.p_value < STRUCTURED:
        remarks.append(f"residuals are spatially correlated (p = {structure.p_value:.1g})")
    if shared.p_value < STRUCTURED and shared.rms > FINEST_PX:
        remarks.append(
            f"each corner of the board has the same error on every photograph, {shared.rms:.2g} px "
            f"(p = {shared.p_value:.1g}): check that the board is flat and accurately printed"
        )
    whose, moved = _of_its_own(evaluation), evaluation.calibration.findings.motion_px
    if np.sqrt(2.0) * moved > FINEST_PX:
        remarks.append(
            f"the boards {whose}moved by {moved:.2g} px during the rolling shutter, which is modelled: keep camera and "
            "board still for a better result"
        )
    factor = evaluation.calibration.findings.disagreement
    if factor > 1.0:
        remarks.append(
            f"the boards {whose}disagree {factor:.2g} times as much as corner noise explains (bent, blurred or moving "
            "boards?): the error bars include this"
        )
    return remarks


def _of_its_own(evaluation: Evaluation) -> str:
    """Words that tell the boards that the camera was made from from others that it is scored on."""
    return "of its calibration " if evaluation.unseen else ""


def _left_out(evaluation: Evaluation) -> str:
    wrong = evaluation.wrong
    remark = f"{wrong.count} of {wrong.found} corners are wrong and were left out"
    return f"{remark}, too many to be wrong corners alone" if wrong.share > TOO_MANY else remark


def _held_out(evaluation: Evaluation) -> str:
    heldout = evaluation.heldout
    if not heldout.requested:
        return f"in-sample error {evaluation.pooled.re_px:.2f} px (no held-out error was requested)"
    if heldout.px is None:
        return f"no held-out error ({heldout.reason})"
    if _imported(evaluation):  # its file does not list the photographs it was made from
        return f"error {heldout.px:.2f} px on these photographs, which it may have been made from"
    return f"held-out error {heldout.px:.2f} px"


def _known(evaluation: Evaluation) -> str:
    if _imported(evaluation):
        return "the file gives no uncertainty of f"
    return f"f known to {100 * _focal(evaluation):.2g} %"


def _imported(evaluation: Evaluation) -> bool:
    return not np.isfinite(_focal(evaluation))


def _focal(evaluation: Evaluation) -> float:
    return float(evaluation.calibration.intrinsics_std[0] / evaluation.calibration.camera.intrinsics.f)
