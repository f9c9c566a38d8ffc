"""Held-out error: train on some boards, refit only the poses of the others, score in px of the original image."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.board import Board
from pinholify.calibration.observation import estimate_pose, sighting_of
from pinholify.calibration.poses import pose_residuals
from pinholify.calibration.result import Calibration
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CalibrationError
from pinholify.evaluation.baseline import BoardPoints, fit_opencv
from pinholify.evaluation.measures import rms
from pinholify.evaluation.wrong_corners import wrong_corners
from pinholify.geometry import ConvexRegion, convex_hull

MINIMUM_CORNERS = 20

PoseResiduals = Callable[[Corners], Floats | None]
"""Residuals (n, 2) px of a view after refitting its pose; None where no pose is found."""


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Boards to ``train`` on, and the corners to ``test``: those inside the hull of all training corners."""

    train: CornerSet
    test: tuple[Corners, ...]


def by_size(views: Sequence[Corners]) -> list[Corners]:
    """Views in decreasing order of the area of their corners' hull."""
    return sorted(views, key=lambda view: -convex_hull(view.uv).area)


def alternating_split(corner_set: CornerSet, views: Sequence[Corners]) -> Split:
    """``views`` of ``corner_set`` by decreasing hull area: train on 0, 1, 3, 5, …, test on 2, 4, 6, …."""
    ordered = by_size(views)
    train = [v for i, v in enumerate(ordered) if i == 0 or i % 2 == 1]
    return _split(corner_set.with_views(train), [v for i, v in enumerate(ordered) if i and i % 2 == 0])


def unseen_split(calibration: Calibration, views: Sequence[Corners]) -> Split:
    """The split that trains on all boards of ``calibration`` and scores ``views``.

    Corners that its fit left out as wrong do not train. An imported camera has no boards: its domain is scored.
    """
    trained = wrong_corners(calibration, calibration.corner_set).left_out_of(calibration.corner_set)
    if not trained.found:
        return Split(trained, _scored(calibration.camera.domain.hull, views))
    return _split(trained.with_views(trained.found), views)


def folds(corner_set: CornerSet, views: Sequence[Corners], count: int) -> list[Split]:
    """``count`` splits of ``views``: the largest board always trains, and every other one is tested once."""
    if not views:
        return []
    first, *others = by_size(views)
    trained = [[first, *(v for i, v in enumerate(others) if i % count != k)] for k in range(count)]
    return [_split(corner_set.with_views(train), others[k::count]) for k, train in enumerate(trained)]


def _split(train: CornerSet, test: Sequence[Corners]) -> Split:
    if not test:
        return Split(train, ())
    return Split(train, _scored(convex_hull(np.concatenate([v.uv for v in train.views])), test))


def _scored(hull: ConvexRegion, test: Sequence[Corners]) -> tuple[Corners, ...]:
    """The corners of ``test`` inside ``hull``, of boards with enough of them."""
    inside = (view.select(hull.contains(view.uv)) for view in test)
    return tuple(view for view in inside if len(view) >= MINIMUM_CORNERS)


def heldout_rms(residuals: PoseResiduals, views: Sequence[Corners]) -> float | None:
    """Pooled per-point RMS in px over ``views``; None if there are none or no pose is found for one of them."""
    each = [residuals(view) for view in views]
    found = [r for r in each if r is not None and np.isfinite(r).all()]
    return rms(np.concatenate(found)) if found and len(found) == len(each) else None


def camera_residuals(calibration: Calibration, board: Board) -> PoseResiduals:
    """Residuals through the camera's own Jacobian after refitting the pose of the ``board``, in its estimated shape.

    None where the map is not one to one at a corner, as beyond the lens's field of view.
    """
    camera, points = calibration.camera, calibration.points_of(board)

    def residuals(view: Corners) -> Floats | None:
        try:
            sighting = sighting_of(camera, points[view.ids], view.uv)
            pose, _ = estimate_pose(camera, sighting)
        except (CalibrationError, np.linalg.LinAlgError):
            return None
        return pose_residuals(sighting, pose, camera.chart)[0].reshape(-1, 2)

    return residuals


def opencv_residuals(model: str, split: Split, board: Board) -> PoseResiduals | None:
    """Residuals of OpenCV's ``model`` trained on ``split``, for views of ``board``; None if it cannot be fitted."""
    trained = [BoardPoints(view.lattice(split.train.board), view.uv) for view in split.train.views]
    camera = fit_opencv(model, trained, split.train.image_size)
    return None if camera is None else lambda view: camera.residuals(BoardPoints(view.lattice(board), view.uv))
