"""Boards as a calibrated camera sees them: which corners count, the homography to the virtual plane, the pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import Board
from pinholify.board import lattice as board_lattice
from pinholify.calibration.poses import Sighting, poses_of_directions, refine_pose
from pinholify.calibration.result import flat
from pinholify.calibration.zhang import pose_from_homography
from pinholify.camera import VirtualCamera
from pinholify.charts import Intrinsics
from pinholify.corners import SAME, Corners, CornerSet, repeated
from pinholify.errors import CalibrationError
from pinholify.geometry import (
    Pose,
    apply_homography,
    estimate_homography,
    homography_jacobian,
    inverse_2x2,
    rotation_to_z,
)

if TYPE_CHECKING:
    from pinholify.gp.maps import PlaneMap

MINIMUM_CORNERS = 8
MINIMUM_SHARE_INSIDE = 0.9  # of a board's corners
MAX_MISFIT_RATIO = 10.0  # to the median misfit of all boards; beyond it corners are wrong
MAX_RAY_ANGLE_RAD = np.deg2rad(85.0)  # from the axis; towards 90° virtual points go to infinity
MAX_PLANE_ANGLE_RAD = np.deg2rad(60.0)  # from the mean ray, of points whose pose starts from a homography
FEWEST_POINTS = 4  # of a pose


@dataclass(frozen=True, slots=True, eq=False)
class MappedBoard:
    """A board in the virtual plane.

    ``inside`` (n,) marks which of its corners count. The arrays hold those corners alone: ``ids`` (m,), ``lattice``
    (m, 2) in squares, ``uv`` (m, 2) in px, virtual points ``xy`` (m, 2) in squares, ``weights`` (m,) and ``whitening``
    (m, 2, 2), which takes squares to px times the weight. ``used`` tells whether the board counts for K and the
    measures, ``reason`` why not. ``homography`` (3, 3) takes the lattice to the virtual plane; ``misfit_px`` is the RMS
    distance per corner that it leaves.
    """

    name: str
    used: bool
    reason: str
    corners: int
    inside: Bools
    ids: Ints
    lattice: Floats
    uv: Floats
    xy: Floats
    weights: Floats
    whitening: Floats
    homography: Floats
    misfit_px: float


@dataclass(frozen=True, slots=True, eq=False)
class ObservedBoard:
    """A used board with its pose, in closed form and refined; both camera_from_board in squares.

    ``points`` (m, 3) are its corners on the board, in squares, and ``projected`` (m, 2) their virtual points at the
    refined pose.
    """

    board: MappedBoard
    closed_form: Pose
    refined: Pose
    points: Floats
    projected: Floats

    @property
    def residual_px(self) -> Floats:
        """Residuals (m, 2) px of the refined pose at the corners that count, without their weights."""
        board = self.board
        moved = board.whitening @ (self.projected - board.xy)[:, :, None]
        return np.asarray(moved[:, :, 0] / board.weights[:, None])


def unused(view: Corners, reason: str, inside: Bools | None = None) -> MappedBoard:
    """The board of ``view`` as one that does not count, for the ``reason`` given."""
    inside = np.zeros(len(view), dtype=bool) if inside is None else inside
    nothing = np.empty((0, 2))
    return MappedBoard(
        view.name, False, reason, len(view), inside, np.empty(0, np.int64),
        nothing, nothing, nothing, np.empty(0), np.empty((0, 2, 2)), np.eye(3), np.nan,
    )


def map_board(view: Corners, board: Board, inside: Bools, xy: Floats, jacobian: Floats) -> MappedBoard:
    """The board of ``view`` in the virtual plane: ``xy`` (m, 2) and ∂xy/∂uv (m, 2, 2) at the corners ``inside``.

    Corners where the map cannot be inverted do not count.
    """
    inverse = inverse_2x2(jacobian)
    invertible = np.isfinite(inverse).all(axis=(1, 2))
    inside = inside.copy()
    inside[inside] = invertible
    xy, inverse = xy[invertible], inverse[invertible]
    count, total = int(inside.sum()), len(view)
    if count < max(MINIMUM_CORNERS, MINIMUM_SHARE_INSIDE * total):
        return unused(view, f"only {count} of {total} corners lie where the camera is valid", inside)
    ids, lattice, uv = view.ids[inside], view.lattice(board)[inside], view.uv[inside]
    if np.linalg.matrix_rank(lattice - lattice.mean(axis=0)) < 2:
        return unused(view, "all its corners lie on one line", inside)
    weights = view.weights[inside]
    whitening = inverse * weights[:, None, None]
    homography = estimate_homography(lattice, xy, whitening)
    if np.linalg.det(homography_jacobian(homography, lattice.mean(axis=0, keepdims=True))[0]) < 0:
        return unused(view, "its corners are numbered with the opposite handedness to the reference's", inside)
    residual = (whitening @ (apply_homography(homography, lattice) - xy)[:, :, None])[:, :, 0]
    misfit = float(np.sqrt((residual**2).sum(axis=1).mean()))
    return MappedBoard(view.name, True, "", total, inside, ids, lattice, uv, xy, weights, whitening, homography, misfit)


def map_boards(corner_set: CornerSet, plane_map: PlaneMap, inside: list[Bools]) -> list[MappedBoard]:
    """The board of every view in the plane of ``plane_map``; ``inside`` are masks, one per view, of what may count.

    Boards that fit a homography much worse than the others are set aside with the reason, and so are repeats of a view.
    """
    boards = [
        map_board(view, corner_set.board, keep, plane_map.value(view.uv[keep]), plane_map.jacobian(view.uv[keep]))
        for view, keep in zip(corner_set.views, inside, strict=True)
    ]
    return without_wrong_corners(without_repeats(boards, corner_set), corner_set)


def without_repeats(boards: list[MappedBoard], corner_set: CornerSet) -> list[MappedBoard]:
    """The same boards, with those that have the same corners as an earlier one set aside."""
    repeats = repeated(corner_set.views)
    return [
        unused(view, f"{SAME} {repeats[view.name]}", b.inside) if b.used and view.name in repeats else b
        for view, b in zip(corner_set.views, boards, strict=True)
    ]


def without_wrong_corners(boards: list[MappedBoard], corner_set: CornerSet) -> list[MappedBoard]:
    """The same boards, with those that fit no plane set aside."""
    misfits = [b.misfit_px for b in boards if b.used]
    limit = MAX_MISFIT_RATIO * float(np.median(misfits)) if len(misfits) > 2 else np.inf
    return [
        unused(view, f"its corners lie {b.misfit_px:.1f} px off any flat board: wrong corners?", b.inside)
        if b.used and b.misfit_px > limit
        else b
        for view, b in zip(corner_set.views, boards, strict=True)
    ]


def observe(
    camera: VirtualCamera,
    corner_set: CornerSet,
    board_points: Floats | None = None,
    closed_form: Intrinsics | None = None,
) -> tuple[list[MappedBoard], dict[str, ObservedBoard]]:
    """All boards of ``corner_set`` as ``camera`` sees them, and those that count with their poses, by name.

    ``board_points`` (corners, 3) are the board's points by id, in squares, by default those of a flat board. The poses
    in closed form are computed with the K of ``closed_form``, by default the camera's.
    """
    closed_form = closed_form or camera.intrinsics
    points = flat(board_lattice(corner_set.board)) if board_points is None else board_points
    mapped = map_views(camera, corner_set)
    used = [b for b in mapped if b.used]
    if not used:
        return mapped, {}
    ids, uv = np.concatenate([b.ids for b in used]), np.concatenate([b.uv for b in used])
    every = sighting_of(camera, points[ids], uv)
    ends = np.cumsum([len(b.uv) for b in used])
    parts = (np.split(each, ends)[:-1] for each in (every.target, every.coordinates, every.whitening))
    seen = [Sighting(*part) for part in zip(*parts, strict=True)]
    return mapped, {b.name: _locate(camera, b, s, closed_form) for b, s in zip(used, seen, strict=True)}


def map_views(camera: VirtualCamera, corner_set: CornerSet) -> list[MappedBoard]:
    """The board of every view of ``corner_set`` in the virtual plane of ``camera``."""
    empty = np.empty((0, 2))
    uv = np.concatenate([empty, *(view.uv for view in corner_set.views)])  # one call of the map for all of them
    directions = camera.chart.directions(camera.plane_map.value(uv))
    inside = camera.inside(uv) & (directions[:, 2] > np.cos(MAX_RAY_ANGLE_RAD))
    xy, jacobian = np.full((len(uv), 2), np.nan), np.full((len(uv), 2, 2), np.nan)
    xy[inside], jacobian[inside] = camera.intrinsics.project(directions[inside]), camera.virtual_jacobian(uv[inside])
    ends = np.cumsum([len(view) for view in corner_set.views])
    parts = (np.split(each, ends)[:-1] for each in (inside, xy, jacobian))
    mapped = [
        map_board(view, corner_set.board, keep, points[keep], slopes[keep])
        if view.found
        else unused(view, view.reason or "no board found")
        for view, keep, points, slopes in zip(corner_set.views, *parts, strict=True)
    ]
    return without_wrong_corners(without_repeats(mapped, corner_set), corner_set)


def sighting_of(camera: VirtualCamera, target: Floats, uv: Floats) -> Sighting:
    """The ``target`` points of a board, (n, 2) on its plane or (n, 3), as ``camera`` saw them at ``uv`` (n, 2) px.

    The whitening is nan where the camera's map is not one to one.
    """
    whitening = inverse_2x2(camera.plane_map.jacobian(uv))
    whitening[~np.isfinite(whitening).all(axis=(1, 2))] = np.nan
    return Sighting(target, camera.plane_map.value(uv), whitening)


def _locate(camera: VirtualCamera, board: MappedBoard, seen: Sighting, closed_form: Intrinsics) -> ObservedBoard:
    """The poses of a used board: in closed form as if it were flat, and refined on its solid points in ``seen``."""
    closed = pose_from_homography(board.homography, closed_form)
    refined, _ = refine_pose(seen, closed, camera.chart)
    projected = camera.intrinsics.project(refined.apply(seen.target))
    return ObservedBoard(board, closed, refined, seen.target, projected)


def estimate_pose(camera: VirtualCamera, seen: Sighting) -> tuple[Pose, Floats]:
    """The pose of least squared px residuals of a flat target, and its covariance (6, 6) at 1 px of noise per axis.

    Rays may be beyond 90° from the axis, and from each other. Points whose coordinates or whitening are not finite do
    not count. Raises CalibrationError for fewer than four others.
    """
    known = np.asarray(np.isfinite(seen.coordinates).all(axis=1) & np.isfinite(seen.whitening).all(axis=(1, 2)))
    if known.sum() < FEWEST_POINTS:
        raise CalibrationError(
            f"a pose needs {FEWEST_POINTS} points whose pixels have rays, and {known.sum()} of {len(known)} do: give "
            "more of them, inside the camera's domain"
        )
    if not known.all():
        seen = Sighting(seen.target[known], seen.coordinates[known], seen.whitening[known])
    return refine_pose(seen, first_pose(seen.target[:, :2], camera.chart.directions(seen.coordinates)), camera.chart)


def first_pose(lattice: Floats, directions: Floats) -> Pose:
    """The pose in closed form of a flat board's points ``lattice`` (n, 2) in squares, seen along ``directions`` (n, 3).

    It is that of a homography to a plane perpendicular to the mean ray, unless points reach far from that ray, where
    the plane magnifies errors or ends.
    """
    axis = directions.mean(axis=0)
    turn = rotation_to_z(axis / np.linalg.norm(axis)).T
    local = directions @ turn
    if local[:, 2].min() < np.cos(MAX_PLANE_ANGLE_RAD):
        middle = lattice.mean(axis=0)
        rotations, translations = poses_of_directions(directions, lattice - middle, np.array([0]))
        return Pose(rotations[0], translations[0] - rotations[0][:, :2] @ middle)
    homography = estimate_homography(lattice, local[:, :2] / local[:, 2:])
    start = pose_from_homography(homography, Intrinsics(1.0, 0.0, 0.0))
    return Pose(turn @ start.rotation, turn @ start.translation)
