"""Realistic sets of board poses for a lens, with their truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.arrays import Floats
from pinholify.board import Board, lattice, outline
from pinholify.geometry import Pose
from pinholify.simulation.lenses import Lens
from pinholify.simulation.lenses.base import image_centre, unit

MAX_TRIES = 200_000
"""Random poses tried before an error is raised."""

AIMS = 0.03 * np.array([[u, v] for u in (0, -1, 1) for v in (0, -1, 1)])
"""Offsets of the first board from the image's centre, in widths and heights, in order of preference."""


def true_corners(lens: Lens, board: Board, pose: Pose) -> Floats:
    """Pixels (N, 2) of the corners of ``board``, in id order, through ``lens``; NaN where they are not imaged."""
    return lens.project(pose.apply(lattice(board)))


def board_poses(
    lenses: Sequence[Lens],
    board: Board,
    count: int,
    *,
    seed: int,
    margin: float = 0.01,
    tilt: float = 40.0,
) -> tuple[Pose, ...]:
    """``count`` poses at which each of ``lenses`` sees the whole ``board`` from its front.

    The first faces the camera near the centre of the image, as near as all lenses allow; the others are at 1.1 to 2.6
    times its distance, rotated by up to ``tilt`` degrees about both axes of the board and slightly in its plane. Every
    corner keeps ``margin`` times the image's width from the border and from its neighbours. Raises ValueError if not
    enough poses are found.
    """
    rng = np.random.default_rng(seed)
    reference, distance = _reference(lenses, board, rng, margin)
    poses = [reference]
    for _ in range(MAX_TRIES):
        if len(poses) == count:
            return tuple(poses)
        uv = rng.uniform(0.1, 0.9, 2) * lenses[0].size
        angles = [rng.normal(0, 8), *rng.uniform(-tilt, tilt, 2)]
        pose = _facing(lenses[0], board, uv, distance * rng.uniform(1.1, 2.6), angles)
        if _sees_board(lenses, board, pose, margin):
            poses.append(pose)
    raise ValueError(f"only {len(poses)} of {count} poses were found that fit in the image; give a smaller tilt")


def virtual_camera(reference: Pose) -> tuple[float, float, float]:
    """The true (f, uc, vc), in squares, of a central lens's virtual camera, from the ``reference`` board's pose."""
    centre = -reference.rotation.T @ reference.translation
    return float(-centre[2]), float(centre[0]), float(centre[1])


def _reference(
    lenses: Sequence[Lens], board: Board, rng: np.random.Generator, margin: float
) -> tuple[Pose, float]:
    angles = rng.normal(0, 1.5, 3)
    aims = image_centre(lenses[0].size) + AIMS * lenses[0].size
    for distance in 0.2 * max(board.columns, board.rows) * 1.025 ** np.arange(300):
        for uv in aims:
            pose = _facing(lenses[0], board, uv, distance, angles)
            if _sees_board(lenses, board, pose, margin):
                return pose, float(distance)
    raise ValueError("there is no distance at which all lenses see the whole board")


def _facing(
    lens: Lens, board: Board, uv: Floats, distance: float, angles: Sequence[float] | Floats
) -> Pose:
    """The pose of a board on the ray of the pixel ``uv``, facing it, then rotated by ``angles`` (z, y, x; degrees)."""
    origins, directions = lens.unproject(uv + np.array([[0.0, 0.0], [0.0, 1.0]]))
    z = directions[0]
    # y points down in the image; x follows, so that the board is right-handed even if a mirror shows it.
    y = unit(((directions[1] - z) - (directions[1] - z) @ z * z)[None])[0]
    turn = Rotation.from_euler("zyx", angles, degrees=True).as_matrix()
    rotation = np.stack([np.cross(y, z), y, z], axis=1) @ turn
    middle = np.append(np.mean(outline(board), axis=0), 0.0)
    return Pose(rotation, origins[0] + distance * z - rotation @ middle)


def _sees_board(lenses: Sequence[Lens], board: Board, pose: Pose, margin: float) -> bool:
    return all(_shows_board(lens, board, pose, margin * lens.size[0]) for lens in lenses)


def _shows_board(lens: Lens, board: Board, pose: Pose, gap: float) -> bool:
    """Whether all corners keep ``gap`` px from border and neighbours and are seen from the board's front."""
    uv = true_corners(lens, board, pose)
    width, height = lens.size
    if not ((uv >= gap) & (uv <= (width - 1 - gap, height - 1 - gap))).all():
        return False
    grid = uv.reshape(board.rows, board.columns, 2)
    if min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1)) < gap:
        return False
    return bool((lens.unproject(uv).directions @ pose.rotation[:, 2] > 0.1).all())
