"""Held-out error: train on some boards, refit only the poses of the others, score in px of the original image."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.observation import estimate_pose, sighting_of
from pinholify.calibration.poses import pose_residuals
from pinholify.calibration.result import Calibration
from pinholify.corners import Corners, CornerSet
from pinholify.evaluation.baseline import BoardPoints, fit_opencv
from pinholify.evaluation.measures import rms
from pinholify.evaluation.wrong_corners import wrong_corners
from pinholify.geometry import ConvexRegion, convex_hull

MINIMUM_CORNERS = 20

PoseResiduals = Callable[[BoardPoints], Floats | None]
"""Residuals (n, 2) px of a board after refitting its pose; None where no pose is found."""


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Boards to ``train`` on, and the corners to ``test``: those inside the hull of all training corners."""

    train: tuple[Corners, ...]
    test: tuple[BoardPoints, ...]


def by_size(views: Sequence[Corners]) -> list[Corners]:
    """Views in decreasing order of the area of their corners' hull."""
    return sorted(views, key=lambda view: -convex_hull(view.uv).area)


def alternating_split(corner_set: CornerSet, views: Sequence[Corners]) -> Split:
    """Boards by decreasing hull area: train on 0, 1, 3, 5, …, test on 2, 4, 6, …."""
    ordered = by_size(views)
    if not ordered:
        return Split((), ())
    train = [v for i, v in enumerate(ordered) if i == 0 or i % 2 == 1]
    return _split(corner_set, train, [v for i, v in enumerate(ordered) if i and i % 2 == 0])


def unseen_split(calibration: Calibration, views: Sequence[Corners]) -> Split:
    """The split that trains on all boards of ``calibration`` and scores ``views``.

    Corners that its fit left out as wrong do not train. An imported camera has no boards: its domain is scored.
    """
    trained = wrong_corners(calibration, calibration.corner_set).left_out_of(calibration.corner_set)
    if not trained.found:
        return Split((), _scored(trained, calibration.camera.domain.hull, views))
    return _split(trained, trained.found, views)


def folds(corner_set: CornerSet, views: Sequence[Corners], count: int) -> list[Split]:
    """``count`` splits over boards: the largest board always trains, and every other one is tested once."""
    if not views:
        return []
    first, *others = by_size(views)
    return [
        _split(corner_set, [first, *(v for i, v in enumerate(others) if i % count != k)], others[k::count])
        for k in range(count)
    ]


def _split(corner_set: CornerSet, train: Sequence[Corners], test: Sequence[Corners]) -> Split:
    hull = convex_hull(np.concatenate([v.uv for v in train]))
    return Split(tuple(train), _scored(corner_set, hull, test))


def _scored(corner_set: CornerSet, hull: ConvexRegion, test: Sequence[Corners]) -> tuple[BoardPoints, ...]:
    """The corners of ``test`` inside ``hull``, of boards with enough of them."""
    scored = []
    for view in test:
        inside = hull.contains(view.uv)
        if inside.sum() >= MINIMUM_CORNERS:
            scored.append(BoardPoints(view.lattice(corner_set.board)[inside], view.uv[inside]))
    return tuple(scored)


def heldout_rms(residuals: PoseResiduals, boards: Sequence[BoardPoints]) -> float | None:
    """Pooled per-point RMS in px over ``boards``; None if there are none or no pose is found for one of them."""
    each = [residuals(board) for board in boards]
    found = [r for r in each if r is not None and np.isfinite(r).all()]
    return rms(np.concatenate(found)) if found and len(found) == len(each) else None


def camera_residuals(calibration: Calibration) -> PoseResiduals:
    """Residuals through the camera's own Jacobian after refitting the pose of the board, in its estimated shape.

    None where the map is not one to one at a corner, as beyond the lens's field of view.
    """
    camera = calibration.camera

    def residuals(board: BoardPoints) -> Floats | None:
        try:
            sighting = sighting_of(camera, calibration.solid(board.lattice), board.uv)
            pose, _ = estimate_pose(camera, sighting)
        except np.linalg.LinAlgError:
            return None
        return pose_residuals(sighting, pose, camera.chart)[0].reshape(-1, 2)

    return residuals


def opencv_residuals(model: str, split: Split, corner_set: CornerSet) -> PoseResiduals | None:
    """Residuals of OpenCV's ``model`` trained on ``split``; None if it cannot be fitted."""
    boards = [BoardPoints(v.lattice(corner_set.board), v.uv) for v in split.train]
    camera = fit_opencv(model, boards, corner_set.image_size)
    return None if camera is None else camera.residuals
