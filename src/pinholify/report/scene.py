"""The scene: the camera, the boards in their poses, and the lines of sight that should meet in one point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.observation import ObservedBoard
from pinholify.calibration.result import Calibration
from pinholify.camera import VirtualCamera
from pinholify.evaluation.measures import PinholeLines, plane_crossings
from pinholify.evaluation.summary import Evaluation
from pinholify.rectification.views import optical_rotation

BEHIND = 0.1  # length of the lines of sight behind the camera, as a fraction of that in front
FAR = 90.0  # percentile of the distances of points on boards at which the lines end
FRUSTUM = 0.35  # depth of the camera's pyramid, as a fraction of the nearest board's distance
STEEPEST = np.cos(np.deg2rad(75.0))  # largest angle to the axis at which the pyramid's edges are drawn


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The scene in squares, in a frame along the optical axis: x right, y down, z forward.

    ``boards`` (n, 4, 3) are outlines in the order of ``names``, ``frustum`` (4, 3) the corners of the camera's view.
    ``lines`` (k, 2 ends, 3) are lines of sight and ``crossings`` (k, 2) where they cross the plane through the camera's
    centre, in units of f; ``pinholeness`` is their mean distance from the centre ÷ f, None below three boards.
    """

    names: tuple[str, ...]
    boards: Floats
    frustum: Floats
    lines: Floats
    crossings: Floats
    pinholeness: float | None


def scene_of(evaluation: Evaluation) -> Scene:
    """The scene of an evaluated calibration."""
    calibration = evaluation.calibration
    turn = optical_rotation(calibration.camera)
    outlines = [_outline(calibration, observed) @ turn.T for observed in evaluation.observed.values()]
    boards = np.array(outlines).reshape(-1, 4, 3)
    nearest = float(np.linalg.norm(boards.mean(axis=1), axis=1).min())
    lines, crossings = _lines_of_sight(evaluation.lines, turn, calibration.camera.intrinsics.f)
    return Scene(
        tuple(evaluation.observed),
        boards,
        _frustum(calibration.camera, turn, FRUSTUM * nearest),
        lines,
        crossings,
        evaluation.pinholeness,
    )


def _outline(calibration: Calibration, observed: ObservedBoard) -> Floats:
    """The board's outermost corners (4, 3)."""
    board = calibration.corner_set.board
    ids = [0, board.columns - 1, board.columns * board.rows - 1, board.columns * (board.rows - 1)]
    return observed.refined.apply(calibration.board_points[ids])


def _frustum(camera: VirtualCamera, turn: Floats, depth: float) -> Floats:
    """The corners (4, 3) of the image at ``depth``; rays beyond 75° from the axis are shortened."""
    right, bottom = (extent - 1.0 for extent in camera.image_size)
    corners = np.array([[0, 0], [right, 0], [right, bottom], [0, bottom]], dtype=np.float64)
    rays = camera.to_rays(corners).directions @ turn.T
    return np.asarray(depth * rays / np.maximum(np.nan_to_num(rays[:, 2:], nan=STEEPEST), STEEPEST))


def _lines_of_sight(lines: PinholeLines | None, turn: Floats, f: float) -> tuple[Floats, Floats]:
    """Segments (k, 2, 3) from behind the centre to the boards, and where they cross the plane z = 0, in units of f."""
    if lines is None:
        return np.empty((0, 2, 3)), np.empty((0, 2))
    anchors, directions = lines.anchors @ turn.T, lines.directions @ turn.T
    forward = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    forward = forward * np.sign(np.einsum("ni,ni->n", forward, anchors))[:, None]
    nearest = anchors - np.einsum("ni,ni->n", anchors, forward)[:, None] * forward
    far = float(np.percentile(np.linalg.norm(np.concatenate(lines.points), axis=1), FAR))
    segments = np.stack([nearest - BEHIND * far * forward, nearest + far * forward], axis=1)
    return segments, plane_crossings(anchors, directions)[:, :2] / f
