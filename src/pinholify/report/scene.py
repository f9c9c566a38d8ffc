"""The scene: the camera, every board where it stood, and the lines of sight that should meet in one point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.observation import ObservedBoard
from pinholify.calibration.result import Calibration
from pinholify.camera import VirtualCamera
from pinholify.evaluation.measures import PinholeLines
from pinholify.evaluation.summary import Evaluation
from pinholify.rectification.views import optical_rotation

BEHIND = 0.1  # of the far end's distance: how far lines of sight are drawn behind the camera
FAR = 90.0  # per cent of the points on boards lie nearer than where the lines end
FRUSTUM = 0.35  # of the nearest board's distance
STEEPEST = np.cos(np.deg2rad(75.0))  # of a ray against the axis, for the camera to be drawn as a pyramid


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything in a frame that looks along the camera's axis: x right, y down, z ahead; squares.

    ``boards`` (n, 4, 3) are outlines in the order of ``names``, ``frustum`` (m, 3) the corners of the camera's view.
    ``lines`` (k, 2 ends, 3) are lines of sight; ``crossings`` (k, 2) is where they cut the plane through the camera's
    centre, in units of f, and ``pinholeness`` their mean distance from it ÷ f, None below three boards.
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
    """The board's outermost corners, (4, 3)."""
    board = calibration.corner_set.board
    ids = [0, board.columns - 1, board.columns * board.rows - 1, board.columns * (board.rows - 1)]
    return observed.refined.apply(calibration.board_points[ids])


def _frustum(camera: VirtualCamera, turn: Floats, depth: float) -> Floats:
    """The four corners of the image at ``depth``; steeper rays are drawn as if they were at 75° from the axis."""
    right, bottom = (extent - 1.0 for extent in camera.image_size)
    corners = np.array([[0, 0], [right, 0], [right, bottom], [0, bottom]], dtype=np.float64)
    rays = camera.to_rays(corners).directions @ turn.T
    return np.asarray(depth * rays / np.maximum(np.nan_to_num(rays[:, 2:], nan=STEEPEST), STEEPEST))


def _lines_of_sight(lines: PinholeLines | None, turn: Floats, f: float) -> tuple[Floats, Floats]:
    """Segments from a little behind the centre to the boards, and where they cut the plane z = 0 ÷ f."""
    if lines is None:
        return np.empty((0, 2, 3)), np.empty((0, 2))
    anchors, directions = lines.anchors @ turn.T, lines.directions @ turn.T
    forward = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    forward = forward * np.sign(np.einsum("ni,ni->n", forward, anchors))[:, None]
    nearest = anchors - np.einsum("ni,ni->n", anchors, forward)[:, None] * forward
    far = float(np.percentile(np.linalg.norm(np.concatenate(lines.points), axis=1), FAR))
    segments = np.stack([nearest - BEHIND * far * forward, nearest + far * forward], axis=1)
    crossings = (nearest - nearest[:, 2:] / forward[:, 2:] * forward)[:, :2] / f
    return segments, crossings
