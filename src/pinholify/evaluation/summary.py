"""The evaluation of a camera on a set of corners: all measures, held-out errors, and OpenCV's models."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.circles import centred
from pinholify.calibration.numbering import Numbered, numbered_alike
from pinholify.calibration.observation import MappedBoard, ObservedBoard, observe
from pinholify.calibration.result import Calibration
from pinholify.calibration.turning import turned_alike
from pinholify.corners import CornerSet
from pinholify.errors import CalibrationError, PinholifyError, solving
from pinholify.evaluation.baseline import MODELS, BoardPoints, fit_opencv
from pinholify.evaluation.heldout import (
    Split,
    alternating_split,
    camera_residuals,
    folds,
    heldout_rms,
    opencv_residuals,
    unseen_split,
)
from pinholify.evaluation.measures import (
    PinholeLines,
    closed_form_percent,
    collinearity_errors,
    mean_spacing,
    pinhole_lines,
    refined_percent,
    rms,
    root_mean_square,
)
from pinholify.evaluation.wrong_corners import WrongCorners, wrong_corners

FOLDS = 5
ELSEWHERE = "use photographs whose boards lie where the camera was calibrated"
UNDETERMINED = (
    "these boards do not determine the camera's map well enough anywhere; move closer, so that the board fills more of "
    "the image, and tilt it in different ways"
)
NO_BOARD_LOCATED = "no board shows enough corners where the camera was calibrated"

Recalibrate = Callable[[CornerSet, str], Calibration]
"""Calibrates a set of corners with the named reference and the settings of the camera that is evaluated."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """The held-out error in ``px``, or None and the ``reason``; what was not ``requested`` says nothing of a camera."""

    px: float | None
    reason: str = ""
    requested: bool = True


NOT_REQUESTED = HeldOut(None, "not requested", requested=False)


@dataclass(frozen=True, slots=True)
class BoardScore:
    """The score of one image; errors are None where its board does not count, with the ``reason``.

    ``corners`` were found, of which ``inside`` lie in the camera's domain and ``wrong`` were rejected by the fit and
    are in no measure. ``note`` says how the corners were changed.
    """

    file: str
    used: bool
    reason: str
    corners: int
    inside: int
    ce: float | None = None
    re_percent: float | None = None
    re_refined_percent: float | None = None
    misfit_px: float | None = None
    note: str = ""
    wrong: int = 0


@dataclass(frozen=True, slots=True)
class Pooled:
    """CE, RE with closed-form and refined poses in %, and the RMS refined residual in px, over counted boards."""

    ce: float
    re_percent: float
    re_refined_percent: float
    re_px: float


@dataclass(frozen=True, slots=True)
class OpenCVScore:
    """Errors of one of OpenCV's models on the same corners; None where a fit or a board's pose failed."""

    insample_px: float | None
    re_percent: float | None
    heldout_px: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """All measures of a calibration on a set of corners.

    ``pooled`` counts all boards; ``pooled_without_reference`` leaves out the reference, which the map was fitted to.
    ``known`` are the names of the photographs that the camera was made from. ``heldout`` is the error of a calibration
    on half of the boards; where no photograph is known it is the error of the camera itself, and OpenCV's models are
    trained on the camera's own. Where only some are known, half of all boards train and the others are scored: the
    error is held out, but that of a camera from these photographs rather than of this one. ``kfold_px``, if requested,
    trains on all but a fifth. ``wrong`` are the corners that the fit rejected as grossly wrong: no measure of any
    method uses them.
    """

    calibration: Calibration
    boards: tuple[BoardScore, ...]
    observed: dict[str, ObservedBoard]
    pooled: Pooled
    pooled_without_reference: Pooled
    pinholeness: float | None
    lines: PinholeLines | None
    heldout: HeldOut
    kfold_px: float | None
    opencv: dict[str, OpenCVScore]
    wrong: WrongCorners
    known: frozenset[str]

    @property
    def heldout_px(self) -> float | None:
        """The held-out error in px; None where there is none."""
        return self.heldout.px

    @property
    def unseen(self) -> bool:
        """Whether the camera was made from none of the photographs."""
        return not self.known

    @property
    def in_sample(self) -> bool:
        """Whether the camera was made from all photographs that count."""
        return self.known.issuperset(self.observed)


@solving()
def evaluate(
    calibration: Calibration,
    corner_set: CornerSet,
    *,
    recalibrate: Recalibrate | None = None,
    compare_opencv: bool = True,
    kfold: bool = False,
) -> Evaluation:
    """Score ``calibration`` on ``corner_set``; held-out errors need ``recalibrate``.

    Corners that its fit rejected as grossly wrong are left out for every method, in training and in scoring. Raises
    CalibrationError where no board can be scored.
    """
    corner_set, notes = _numbered(calibration, corner_set.typically_weighted)
    corner_set = centred(corner_set, calibration)
    known = frozenset(view.name for view in corner_set.found if calibration.known(view))
    wrong = wrong_corners(calibration, corner_set)
    corner_set = wrong.left_out_of(corner_set)
    points = calibration.points_of(corner_set.board)
    mapped, observed = observe(calibration.camera, corner_set, points, calibration.closed_form)
    if not observed:
        raise _unscorable(mapped, UNDETERMINED if known else ELSEWHERE)
    lines = pinhole_lines(calibration.camera, list(observed.values()))
    views = [v for v in corner_set.views if v.name in observed]
    if not known:
        split = unseen_split(calibration, corner_set.found)
        error = heldout_rms(camera_residuals(calibration, corner_set.board), split.test)
        heldout = HeldOut(error, NO_BOARD_LOCATED if error is None else "")
    else:
        split = alternating_split(corner_set, views)
        heldout = _heldout(recalibrate, [split])
    kfold_px = _heldout(recalibrate, folds(corner_set, views, FOLDS)).px if kfold else None
    opencv = _opencv(corner_set, mapped, split) if compare_opencv else {}
    measured = {name: _measured(o, calibration) for name, o in observed.items()}
    return Evaluation(
        calibration,
        _board_scores(mapped, measured, notes, wrong.counts),
        observed,
        _pooled(list(measured.values())),
        _pooled([m for name, m in measured.items() if name != calibration.reference]),
        None if lines is None else float(lines.distances.mean()),
        lines,
        heldout,
        kfold_px,
        opencv,
        wrong,
        known,
    )


def _numbered(calibration: Calibration, corner_set: CornerSet) -> Numbered:
    """``corner_set`` numbered as the boards of ``calibration`` are."""
    alike, reversed_ones = numbered_alike(corner_set, calibration.camera.mirrored)
    alike, turned = turned_alike(calibration, alike)
    return Numbered(alike, {**reversed_ones, **turned})


def _unscorable(mapped: Sequence[MappedBoard], remedy: str) -> CalibrationError:
    reasons = sorted({board.reason for board in mapped if board.corners}) or ["no board was found"]
    return CalibrationError(f"none of the {len(mapped)} images can be scored ({reasons[0]}): {remedy}")


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Measures of one board: CE of its ``lines``, RE in %, and ``residuals`` (n, 2) px of the refined pose."""

    lines: Floats
    re_percent: float
    re_refined_percent: float
    residuals: Floats


def _measured(observed: ObservedBoard, calibration: Calibration) -> _Measured:
    return _Measured(
        collinearity_errors(observed.board.lattice, observed.board.xy),
        closed_form_percent(observed, calibration.closed_form or calibration.camera.intrinsics),
        refined_percent(observed),
        observed.residual_px,
    )


def _board_scores(
    mapped: Sequence[MappedBoard], measured: Mapping[str, _Measured], notes: Mapping[str, str], wrong: Mapping[str, int]
) -> tuple[BoardScore, ...]:
    return tuple(
        _board_score(board, measured.get(board.name), notes.get(board.name, ""), wrong.get(board.name, 0))
        for board in mapped
    )


def _board_score(board: MappedBoard, measured: _Measured | None, note: str, wrong: int) -> BoardScore:
    inside, corners = int(board.inside.sum()), board.corners + wrong
    if measured is None:
        return BoardScore(board.name, False, board.reason, corners, inside, note=note, wrong=wrong)
    ce = float(measured.lines.mean())
    percents = measured.re_percent, measured.re_refined_percent
    return BoardScore(board.name, True, "", corners, inside, ce, *percents, board.misfit_px, note, wrong)


def _pooled(boards: Sequence[_Measured]) -> Pooled:
    return Pooled(
        float(np.concatenate([b.lines for b in boards]).mean()) if boards else float("nan"),
        root_mean_square(b.re_percent for b in boards),
        root_mean_square(b.re_refined_percent for b in boards),
        rms(np.concatenate([b.residuals for b in boards])) if boards else float("nan"),
    )


def _heldout(recalibrate: Recalibrate | None, splits: Sequence[Split]) -> HeldOut:
    """The pooled held-out RMS over ``splits``."""
    squares, count = 0.0, 0
    if recalibrate is None:
        return NOT_REQUESTED
    if not splits or not all(split.test for split in splits):
        return HeldOut(None, "too few boards to hold some out")
    for split in splits:
        try:
            trained = recalibrate(split.train, split.train.views[0].name)
        except PinholifyError as error:
            return HeldOut(None, f"half of the boards do not determine a camera: {error}")
        value = heldout_rms(camera_residuals(trained, split.train.board), split.test)
        if value is None:
            return HeldOut(None, "a held-out board could not be located by the camera made from the others")
        points = sum(map(len, split.test))
        squares, count = squares + value**2 * points, count + points
    return HeldOut(float(np.sqrt(squares / count)))


def _opencv(corner_set: CornerSet, mapped: Sequence[MappedBoard], split: Split) -> dict[str, OpenCVScore]:
    boards = [BoardPoints(b.lattice, b.uv) for b in mapped if b.used]
    return {model: _opencv_score(model, boards, corner_set, split) for model in MODELS}


def _opencv_score(model: str, boards: list[BoardPoints], corner_set: CornerSet, split: Split) -> OpenCVScore:
    camera = fit_opencv(model, boards, corner_set.image_size) if boards else None
    insample = percent = None
    if camera is not None:
        each = [camera.residuals(b) for b in boards]
        if all(r is not None for r in each):
            residuals = [r for r in each if r is not None]
            insample = rms(np.concatenate(residuals))
            percent = root_mean_square(
                100.0 * rms(r) / mean_spacing(b.lattice, b.uv) for r, b in zip(residuals, boards, strict=True)
            )
    trained = opencv_residuals(model, split, corner_set.board) if split.test else None
    return OpenCVScore(insample, percent, heldout_rms(trained, split.test) if trained else None)
