"""Is it good? One plain sentence, and what it rests on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.calibration.result import Calibration
from pinholify.camera import VirtualCamera
from pinholify.corners import CornerSet
from pinholify.evaluation.shared_error import shared_error_of
from pinholify.evaluation.summary import NOT_ASKED, Evaluation
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

POOR_PX, POOR_RATIO = 1.0, 4.0  # held-out error: in px, and times what the noise alone would leave
FAIR_RATIO = 1.5
USUAL_PX, ROUGH_PX = 0.3, 0.5  # noise of a corner per axis: at most so much is usual; not even blur explains more
POOR_FOCAL = 0.02  # relative standard deviation of f
ENOUGH_COVERAGE = 0.6
STRUCTURED = 0.01  # p-value
ALIKE = 1e-4  # p-value: wrong corners that err alike are no chance errors, and hide what the camera does not explain
WRONG_RATIO = 2.0  # times the residuals of the other boards
FINEST_PX = 0.03  # a point: corners are found no finer even in faultless pictures, so that less says nothing
ROUGH = "blurred photographs, a board that is bent, or two cameras?"
GRID = 64


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Residuals of an evaluation, as :mod:`pinholify.refinement.diagnosis` wants them."""

    residuals: Mapping[str, Floats]
    inliers: Mapping[str, Bools]
    noise_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """``level`` is good, fair or poor; ``sentence`` says why.

    ``structure`` tests whether residuals close together are alike, ``shared`` whether those of each corner of the board
    are, ``left_out`` whether the wrong corners, which are in no measure, err alike. ``coverage`` is the share of the
    image in the camera's domain, ``suspicious`` are boards whose residuals are too large, ``next_board`` is
    where one more photograph would help most (joint cameras alone).
    """

    level: str
    sentence: str
    structure: Structure
    coverage: float
    suspicious: tuple[BoardSuspicion, ...]
    next_board: NextBoard | None
    left_out: Structure
    shared: SharedError


def judge(evaluation: Evaluation, corner_set: CornerSet) -> Verdict:
    """The verdict on an ``evaluation`` of a calibration with ``corner_set``."""
    camera = evaluation.calibration.camera
    seen = residuals_of(evaluation, corner_set)
    structure = structure_of(seen, corner_set)
    suspicious = tuple(s for s in suspicious_boards(seen, corner_set) if s.ratio > WRONG_RATIO)
    covered = coverage(camera)
    advice = next_board(camera, corner_set.board, {n: o.refined for n, o in evaluation.observed.items()})
    left_out = structure_of(errors_left_out(evaluation, corner_set), corner_set)
    shared = shared_error_of(evaluation.calibration, evaluation.observed.values())
    level, reasons = _level(evaluation, noise_floor(evaluation, corner_set), covered, left_out, suspicious)
    reasons += _remarks(evaluation, structure, shared)
    sentence = f"{level.capitalize()}: {_held_out(evaluation)}, {_known(evaluation)}"
    sentence += "".join(f"; {reason}" for reason in reasons)
    if advice is not None:
        sentence += f"; to gain most, photograph the board {place(advice, camera.image_size)}"
    return Verdict(level, sentence + ".", structure, covered, suspicious, advice, left_out, shared)


def residuals_of(evaluation: Evaluation, corner_set: CornerSet) -> Residuals:
    """Residuals (n, 2) px beside all corners of each counted view, nan (and no inlier) where a corner did not count."""
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
    # A board can only look wrong beside the others: where they all misfit it is the camera that does.
    typical = [np.sqrt((residuals[n][keep] ** 2).mean()) for n, keep in inliers.items() if keep.any()]
    noise = evaluation.calibration.camera.noise_px
    return Residuals(residuals, inliers, max([float(np.median(typical or 0.0)), noise, FINEST_PX / np.sqrt(2.0)]))


def structure_of(seen: Residuals, corner_set: CornerSet) -> Structure:
    """Whether residuals close together are alike; no structure where there is nothing to see."""
    return residual_structure(seen, corner_set) if seen.residuals else Structure(0.0, 1.0)


def errors_left_out(evaluation: Evaluation, corner_set: CornerSet) -> Residuals:
    """Directions (unit vectors) in which the wrong corners of counted views err: chance errors share none.

    Of length one, so that the grossest do not drown the others.
    """
    calibration, directions, wrong = evaluation.calibration, {}, {}
    for view in corner_set.views:
        mask, observed = ~evaluation.wrong.belonging(view), evaluation.observed.get(view.name)
        if observed is None or not mask.any():
            continue
        points = observed.refined.apply(calibration.solid(view.lattice(corner_set.board)))
        with np.errstate(all="ignore"):
            error = calibration.camera.project(points) - view.uv
        each = error / np.linalg.norm(error, axis=1, keepdims=True) / view.weights[:, None]
        directions[view.name], wrong[view.name] = each, mask & np.isfinite(each).all(axis=1)
    return Residuals(directions, wrong, 1.0)


def noise_floor(evaluation: Evaluation, corner_set: CornerSet) -> float:
    """What the corners' noise, and boards that moved, leave of any camera, px a point: √2 times the std of a corner of
    typical weight.
    """
    weights = np.concatenate([view.weights for view in evaluation.wrong.left_out_of(corner_set).found])
    error = np.hypot(evaluation.calibration.camera.noise_px, motion(evaluation.calibration))
    return float(np.sqrt(2.0 * (weights**-2.0).mean()) * error)


def coverage(camera: VirtualCamera) -> float:
    """The share of the image in the domain of ``camera``, where corners count."""
    u, v = ((np.arange(GRID) + 0.5) * extent / GRID - 0.5 for extent in camera.image_size)  # middles of equal cells
    return float(camera.inside(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)).mean())


def motion(calibration: Calibration) -> float:
    """By how many px, rms an axis, its boards moved while the shutter rolled, beyond what a pose makes good."""
    moved = calibration.details.get("motion_px")
    return float(moved) if isinstance(moved, (int, float)) else 0.0


def disagreement(calibration: Calibration) -> float:
    """How many times more the boards pull a joint camera apart than their corners' noise explains; 1 if no more."""
    factor = calibration.details.get("disagreement")
    return float(factor) if isinstance(factor, (int, float)) else 1.0


def place(advice: NextBoard, image_size: tuple[int, int]) -> str:
    """Where in the image, in words: ``at the upper left``."""
    x, y = advice.outline.mean(axis=0) / image_size
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
    """The level, and the reasons for it: the noise ``floor`` is a yardstick only as far as it is that of corners."""
    heldout = evaluation.heldout_px
    unknown = heldout is None and evaluation.heldout_reason != NOT_ASKED
    error = evaluation.pooled.re_px if heldout is None else heldout
    noise = floor / np.sqrt(2.0)
    off = error > max(POOR_PX, POOR_RATIO * np.sqrt(2.0) * min(noise, USUAL_PX))
    known = _imported(evaluation) or _focal(evaluation) < POOR_FOCAL
    alike = left_out.p_value < ALIKE
    hidden = evaluation.wrong.share > (MANY if alike else TOO_MANY)
    reasons = []
    if error > FAIR_RATIO * max(floor, FINEST_PX):
        alone = "noise and its boards' motion" if motion(evaluation.calibration) > 0.0 else "noise"
        reasons.append(f"its corners' {alone} alone would leave {floor:.2f} px")
    if noise > ROUGH_PX:
        reasons.append(f"its corners scatter by {noise:.2g} px, {USUAL_PX:g} or less is usual: {ROUGH}")
    if covered < ENOUGH_COVERAGE:
        reasons.append(f"boards cover only {100 * covered:.0f} % of the image")
    if evaluation.calibration.details.get("too_few_boards"):
        reasons.append("its boards differ as if they had moved or were uneven, which more photographs would tell")
    if suspicious:
        reasons.append(f"boards that look wrong: {', '.join(s.name for s in suspicious[:3])}")
    if evaluation.wrong.crowded:
        reasons.append(f"boards with too many wrong corners: {', '.join(evaluation.wrong.crowded[:3])}")
    if alike:
        reasons.append(f"corners taken for wrong err alike (p = {left_out.p_value:.1g}): maybe it is the camera")
    level = "poor" if unknown or off or not known or hidden else "fair" if reasons else "good"
    return level, reasons


def _remarks(evaluation: Evaluation, structure: Structure, shared: SharedError) -> list[str]:
    """What is said beside the reasons for the level."""
    remarks = []
    if evaluation.wrong.share > MANY:
        remarks.append(_left_out(evaluation))
    if structure.p_value < STRUCTURED:
        remarks.append(f"residuals still hang together over the image (p = {structure.p_value:.1g})")
    if shared.p_value < STRUCTURED and shared.rms_px > FINEST_PX:
        remarks.append(
            f"the corners are off alike on every board, by {shared.rms_px:.2g} px (p = {shared.p_value:.1g}): is the "
            "board flat and printed true?"
        )
    moved = motion(evaluation.calibration)
    if np.sqrt(2.0) * moved > FINEST_PX:
        remarks.append(
            f"the boards moved by {moved:.2g} px while the shutter rolled, which is allowed for: hold camera and board "
            "still for more"
        )
    factor = disagreement(evaluation.calibration)
    if factor > 1.0:
        remarks.append(
            f"its boards disagree {factor:.2g} times as much as their corners' noise explains (bent, blurred or moving "
            "boards?): the error bars count that"
        )
    return remarks


def _left_out(evaluation: Evaluation) -> str:
    wrong = evaluation.wrong
    said = f"{wrong.count} of {wrong.found} corners are wrong and were left out"
    return f"{said}, too many to be wrong corners alone" if wrong.share > TOO_MANY else said


def _held_out(evaluation: Evaluation) -> str:
    if evaluation.heldout_reason == NOT_ASKED:
        return f"its own photographs are off by {evaluation.pooled.re_px:.2f} px (a held-out error was not asked for)"
    if evaluation.heldout_px is None:
        return f"no held-out error is known ({evaluation.heldout_reason})"
    if _imported(evaluation):  # its file does not tell what it was made of
        return f"these photographs, which it may have seen or not, are off by {evaluation.heldout_px:.2f} px"
    return f"photographs it has not seen are off by {evaluation.heldout_px:.2f} px"


def _known(evaluation: Evaluation) -> str:
    if _imported(evaluation):
        return "how well f is known is not in its file"
    return f"f is known to {100 * _focal(evaluation):.2g} %"


def _imported(evaluation: Evaluation) -> bool:
    return not np.isfinite(_focal(evaluation))


def _focal(evaluation: Evaluation) -> float:
    return float(evaluation.calibration.intrinsics_std[0] / evaluation.calibration.camera.intrinsics.f)
