"""From corners to a camera: :func:`calibrate` chooses the method, and prepares the corners for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.circles import local_centres, needs_centres, true_centres
from pinholify.calibration.condensing import condensed
from pinholify.calibration.intrinsics import check_determined
from pinholify.calibration.methods import METHODS
from pinholify.calibration.numbering import check_numbering, check_size, numbered_alike
from pinholify.calibration.one_image import calibrate_one_image
from pinholify.calibration.reference import reference_views
from pinholify.calibration.result import Calibration, Settings
from pinholify.calibration.turning import turned_alike
from pinholify.camera import VirtualCamera, virtual
from pinholify.corners import CornerSet
from pinholify.errors import CalibrationError, InputError, PinholifyError, solving
from pinholify.gp.kernels import kernel_named
from pinholify.gp.trends import trends_named
from pinholify.refinement import JointResult, refine
from pinholify.refinement.observations import lattice_middle
from pinholify.refinement.spectral import density_named
from pinholify.refinement.trends import searches_named

FEWEST_FOR_JOINT = 4  # boards with which "auto" chooses the joint method
MAX_JOINT_CORNERS = 12_000  # of all boards; more are condensed, or the solve takes minutes
MIN_CORNERS_PER_BOARD = 400  # on average: boards of ordinary size are never condensed, however many they are
CENTRINGS = 2  # rounds of a circle grid: the first camera, from centroids, is still slightly wrong
TURNINGS = 8  # rounds of numbering boards alike; five have been enough

Progress = Callable[[str], None]
Make = Callable[[CornerSet], Calibration]


@solving()
def calibrate(
    corner_set: CornerSet,
    *,
    reference: str | None = None,
    method: str = "auto",
    kernel: str = "se",
    trend: str = "auto",
    mirrored: bool = False,
    start: VirtualCamera | None = None,
    square_mm: float | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """A perfect pinhole camera from the corners of several photographs of one board.

    ``reference`` names the image whose board fixes the camera's frame (the largest by default). ``method`` is
    ``one-image`` (the paper's: that board alone makes the map), ``joint`` (all boards do), or ``auto``: the only one
    that knows ``kernel`` and ``trend``, or joint with at least four boards or a ``start``. ``kernel`` and ``trend`` are
    names of the registries in :mod:`pinholify.gp` and :mod:`pinholify.refinement`. ``mirrored`` means that the image is
    a reflection; ``square_mm`` is the side of a square in mm. ``start`` is a camera close to the one sought: the joint
    method starts from it where it explains the corners clearly better than the start found without it, and
    ``details["start_fits"]`` is False where it explains them clearly worse. ``progress`` is called with one line per
    stage. The discs of a circle grid are centred twice, each time with the camera found before. A board numbered with
    the wrong handedness, or unlike the others from its other end, is renumbered and listed in
    ``details["renumbered_boards"]``. Raises InputError, CalibrationError or DegenerateError.
    """
    if corner_set.outside:
        raise InputError(f"{corner_set.outside}: give the size of the photographs as image_size")
    check_size(corner_set)
    method = method_knowing(method, kernel, trend)
    if method == "auto":
        method = "joint" if start is not None or len(corner_set.found) >= FEWEST_FOR_JOINT else "one-image"
    if method == "one-image" and start is not None:
        raise InputError(
            "a start was given to the one-image method, which takes none because its reference board alone makes "
            "the map: choose the method 'joint', or give no start"
        )
    if square_mm is not None and not 0.0 < square_mm < np.inf:
        raise InputError(f"the side of a square is {square_mm:g} mm, but must be positive: give square_mm in mm")
    settings = Settings(method, kernel, trend, mirrored, None if start is None else virtual(start))
    return _calibrated(corner_set, settings, reference, square_mm, progress)


@solving()
def recalibrate(calibration: Calibration, corner_set: CornerSet, reference: str) -> Calibration:
    """Other corners, as of half of the boards, calibrated with the settings of ``calibration``, its start included.

    ``reference`` names the image whose board fixes the frame. Where the settings are unknown, as in a camera file
    without them, the trend is chosen again by the joint method, and kept by the one-image method. Raises InputError for
    an imported camera, and else as :func:`calibrate`.
    """
    settings = calibration.settings
    if settings is None:
        trend = calibration.trend if calibration.method == "one-image" else "auto"
        method = method_knowing(calibration.method, calibration.kernel, trend)
        settings = Settings(method, calibration.kernel, trend, calibration.camera.mirrored)
    return _calibrated(corner_set, settings, reference)


def method_knowing(method: str, kernel: str, trend: str) -> str:
    """``method``, or in place of ``auto`` the only method that knows both ``kernel`` and ``trend``.

    Raises InputError for an unknown method, and for names that it does not know.
    """
    if method not in METHODS:
        raise InputError(f"unknown method '{method}': choose one of {', '.join(METHODS)}")
    reasons = {name: _unknown(name, kernel, trend) for name in METHODS if method in ("auto", name) and name != "auto"}
    able = [name for name, reason in reasons.items() if not reason]
    if not able:
        raise InputError("; ".join(reasons.values()))
    return able[0] if len(able) == 1 else method


def _unknown(method: str, kernel: str, trend: str) -> str:
    """Why ``method`` does not support ``kernel`` or ``trend``; empty if it does."""
    try:
        if method == "joint":
            density_named(kernel)
            searches_named(trend)
        else:
            kernel_named(kernel)
            if trend != "constant":
                trends_named(trend)
    except InputError as error:
        return str(error)
    return ""


def _calibrated(
    corner_set: CornerSet,
    settings: Settings,
    reference: str | None,
    square_mm: float | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """:func:`calibrate` by ``settings`` whose method is no longer ``auto``."""
    check_numbering(corner_set, settings.mirrored)
    corner_set, renumbered = numbered_alike(corner_set, settings.mirrored)
    solve = _joint if settings.method == "joint" else _one_image
    make = partial(solve, settings=settings, reference=reference, square_mm=square_mm, progress=progress)
    calibration, turned = _turned(make, corner_set.typically_weighted, progress)
    details = {**calibration.details, "renumbered_boards": {**renumbered, **turned}}
    return _weighted_as(corner_set, replace(calibration, details=details, settings=settings))


def _weighted_as(given: CornerSet, calibration: Calibration) -> Calibration:
    """``calibration`` of corners whose typical weight is 1, with the weights of ``given`` and the noise of weight 1."""
    camera, pairs = calibration.camera, zip(calibration.corner_set.views, given.views, strict=True)
    corners = calibration.corner_set.with_views(replace(view, weights=own.weights) for view, own in pairs)
    return replace(
        calibration, camera=replace(camera, noise_px=camera.noise_px * given.typical_weight), corner_set=corners
    )


def _turned(make: Make, corner_set: CornerSet, progress: Progress | None) -> tuple[Calibration, dict[str, str]]:
    """What ``make`` finds once boards that were held the other way up are numbered alike, and notes on these."""
    turned: dict[str, str] = {}
    calibration = _centred(make, corner_set)
    for _ in range(TURNINGS):
        corner_set, notes = turned_alike(calibration, corner_set, keep=calibration.reference)
        if not notes:
            break
        if progress is not None:
            progress(f"boards that fit the board's shape better after half a turn: {len(notes)}; solving again")
        turned = {name: notes.get(name) or turned[name] for name in turned.keys() ^ notes.keys()}
        calibration = _centred(make, corner_set)
    return calibration, turned


def _centred(make: Make, corner_set: CornerSet) -> Calibration:
    """What ``make`` finds from ``corner_set``, from the middles of its discs if its board has any."""
    if not needs_centres(corner_set):
        return make(corner_set)
    calibration = make(local_centres(corner_set))
    for _ in range(CENTRINGS):
        calibration = make(true_centres(corner_set, calibration.camera))
    return calibration


def _one_image(
    corner_set: CornerSet,
    *,
    settings: Settings,
    reference: str | None,
    square_mm: float | None,
    progress: Progress | None,
) -> Calibration:
    """The one-image method on corners that are points."""
    return calibrate_one_image(
        corner_set,
        reference=reference,
        kernel=settings.kernel,
        trend=settings.trend,
        mirrored=settings.mirrored,
        square_mm=square_mm,
        progress=progress,
    )


def _joint(
    corner_set: CornerSet,
    *,
    settings: Settings,
    reference: str | None,
    square_mm: float | None,
    progress: Progress | None,
) -> Calibration:
    """The joint method on corners that are points."""
    name, *stand_ins = (view.name for view in reference_views(corner_set, reference))
    fewer = condensed(corner_set, max(MAX_JOINT_CORNERS, MIN_CORNERS_PER_BOARD * len(corner_set.found)))
    try:
        result = refine(
            fewer,
            reference=name,
            stand_ins=stand_ins,
            mirrored=settings.mirrored,
            kernel=settings.kernel,
            trend=settings.trend,
            start=settings.start,
            progress=progress,
        )
    except np.linalg.LinAlgError:
        raise _why_unsolvable(corner_set, name, settings.mirrored) from None
    check_determined(result.camera, _agreeing(fewer, result), result.reference)
    return _calibration(result, fewer, corner_set, square_mm)


def _why_unsolvable(corner_set: CornerSet, reference: str, mirrored: bool) -> PinholifyError:
    """The error for boards that the joint method cannot solve.

    Parallel boards can be told from wrong corners only in a virtual plane: that of the one-image method, which refuses
    them with its own error.
    """
    try:
        calibrate_one_image(corner_set, reference=reference, mirrored=mirrored)
    except PinholifyError as reason:
        return reason
    return CalibrationError(
        f"no camera fits the corners of the {len(corner_set.found)} boards together: look for wrongly numbered corners"
    )


def _agreeing(corner_set: CornerSet, result: JointResult) -> CornerSet:
    """The corners that ``result`` was computed from."""
    used = [view for view in corner_set.views if view.name in result.inliers]
    return corner_set.with_views(view.select(result.inliers[view.name]) for view in used)


def _calibration(
    result: JointResult,
    fewer: CornerSet,
    corner_set: CornerSet,
    square_mm: float | None,
) -> Calibration:
    shape = result.shape
    points = shape.points + np.append(lattice_middle(corner_set.board), 0.0)
    details: dict[str, object] = {
        "log_evidence": dict(result.candidates),
        "kernel_px": [float(v) for v in result.kernel_px],
        "dropped_boards": dict(result.dropped),
        "dropped_corners": result.dropped_corners,
        "wrong_corners": _wrong_corners(result, fewer, corner_set, points),
        "board_bow_squares": shape.bow,
        "board_stretch": shape.stretch,
        "board_shear": shape.shear,
        "board_warp_squares": shape.warp,
        "start_fits": result.start_fits,
        "disagreement": result.disagreement,
        "motion_px": result.motion_px,
        "too_few_boards": result.too_few,
        "board_noise_px": dict(result.board_noise_px),
        "board_bow_mm": _in_mm(shape.bow, square_mm),
        "board_warp_mm": _in_mm(shape.warp, square_mm),
    }
    return Calibration(
        result.camera,
        corner_set,
        "joint",
        result.kernel,
        result.trend,
        result.reference,
        result.intrinsics_std,
        square_mm,
        board_points=points,
        details=details,
    )


def _in_mm(squares: float | None, square_mm: float | None) -> float | None:
    return None if squares is None or square_mm is None else squares * square_mm


def _wrong_corners(
    result: JointResult, fewer: CornerSet, corner_set: CornerSet, points: Floats
) -> dict[str, list[int]]:
    """Ids of the corners of each view that the solve of ``fewer`` rejects; ``points`` (corners, 3) are the board's."""
    pairs = zip(corner_set.views, fewer.views, strict=True)
    inliers = {v.name: result.inliers_of(v, solved, points) for v, solved in pairs if v.name in result.inliers}
    wrong = {view.name: view.ids[~inliers[view.name]] for view in corner_set.views if view.name in inliers}
    return {name: ids.tolist() for name, ids in wrong.items() if len(ids)}
