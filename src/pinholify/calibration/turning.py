"""Boards that were held the other way up though no picture shows it: the board's own shape does.

A checkerboard whose columns and rows add up to an even number looks the same after half a turn. As long as it is taken
for a perfect lattice, it does not matter from which end it is numbered. But printed boards are uneven, and a shape that
is estimated from views numbered from both ends is blurred.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinholify.arrays import Floats, Ints
from pinholify.board import size
from pinholify.calibration.numbering import FEWEST_CORNERS, Numbered
from pinholify.calibration.observation import estimate_pose, sighting_of
from pinholify.calibration.poses import pose_residuals
from pinholify.calibration.result import Calibration
from pinholify.corners import Corners, CornerSet

MINIMUM_GAIN = 2.0  # in log likelihood: no view is turned by rounding, and few that say little by chance
NEGLIGIBLE_SHAPE = 1e-9  # squares
NOTE = "renumbered from the other end, to match the board's shape"


def turned_alike(calibration: Calibration, corner_set: CornerSet, keep: str | None = None) -> Numbered:
    """``corner_set`` with the boards renumbered that fit the shape found by ``calibration`` better after half a turn.

    Corners keep their order. Nothing changes where pictures show which way up the board is, where its shape is the
    same either way up, or for another board. The view named ``keep`` keeps its numbering: if it fits better turned, all
    those that do not are renumbered instead.
    """
    points = calibration.points_of(corner_set.board)
    if corner_set.board.orientable or not _asymmetry(points) > NEGLIGIBLE_SHAPE:
        return Numbered(corner_set, {})
    turned = {view.name for view in corner_set.found if _fits_better_turned(calibration, view)}
    if keep in turned:
        turned = {view.name for view in corner_set.found} - turned
    views = [_half_turned(view, calibration) if view.name in turned else view for view in corner_set.views]
    return Numbered(corner_set.with_views(views), dict.fromkeys(sorted(turned), NOTE))


def _asymmetry(points: Floats) -> float:
    """How far the board's ``points`` (corners, 3) are from their places after half a turn about its middle."""
    turned = (points * [-1.0, -1.0, 1.0])[::-1]
    apart = turned - points
    return float(np.abs(apart - apart.mean(axis=0)).max())


def _half_turned(view: Corners, calibration: Calibration) -> Corners:
    return replace(view, ids=size(calibration.corner_set.board) - 1 - view.ids)


def _fits_better_turned(calibration: Calibration, view: Corners) -> bool:
    seen = view.select(calibration.camera.inside(view.uv))
    points = seen.lattice(calibration.corner_set.board)
    if len(seen) < FEWEST_CORNERS or np.linalg.matrix_rank(points - points.mean(axis=0)) < 2:  # on one line: no pose
        return False
    both = [_lengths(calibration, seen.uv, each.ids) for each in (seen, _half_turned(seen, calibration))]
    now, then = (each[np.isfinite(both).all(axis=0)] for each in both)
    if len(now) < FEWEST_CORNERS:
        return False
    scale = max(min(float(np.median(now)), float(np.median(then))), 1e-12)
    gain = np.log1p((now / scale) ** 2).sum() - np.log1p((then / scale) ** 2).sum()  # wrong corners count little
    return bool(gain > MINIMUM_GAIN)


def _lengths(calibration: Calibration, uv: Floats, ids: Ints) -> Floats:
    """Lengths (n,) px of what the best pose leaves at ``uv`` (n, 2) px of the board's points ``ids`` (n,)."""
    camera = calibration.camera
    sighting = sighting_of(camera, calibration.board_points[ids], uv)
    pose, _ = estimate_pose(camera, sighting)
    return np.asarray(np.linalg.norm(pose_residuals(sighting, pose, camera.chart)[0].reshape(-1, 2), axis=1))
