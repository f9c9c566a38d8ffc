"""Synthetic cameras that several tests share: boards seen through known lenses, with noise."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.board import Checkerboard, lattice
from pinholify.corners import Corners, CornerSet

BOARD = Checkerboard(15, 9)
SIZE = (1920, 1200)
FOCAL = 1000.0
TRUE_F = 9.0  # distance of the reference board in squares
CENTRE = (np.array(SIZE) - 1) / 2.0


def project(points, squeeze=0.0):
    """A pinhole camera, with barrel distortion where ``squeeze`` is positive."""
    p = points[:, :2] / points[:, 2:]
    return CENTRE + FOCAL * p / (1.0 + squeeze * (p**2).sum(axis=1, keepdims=True))


def board_poses(count, seed):
    """The reference pose, seen straight and filling the frame, and tilted others behind it."""
    rng = np.random.default_rng(seed)
    middle = lattice(BOARD).mean(axis=0)
    poses = [(np.eye(3), np.array([-7.0, -4.0, TRUE_F]))]
    while len(poses) < count:
        rotation = Rotation.from_euler("xyz", [*rng.uniform(-35, 35, 2), rng.normal(0, 5)], degrees=True).as_matrix()
        centre = np.array([rng.uniform(-3, 3), rng.uniform(-1.5, 1.5), rng.uniform(14, 20)])
        poses.append((rotation, centre - rotation[:, :2] @ middle))
    return poses


def corner_set(count=9, *, squeeze=0.0, noise=0.1, seed=0, poses=None):
    """A :class:`CornerSet` of ``count`` views; the first is the reference at distance TRUE_F."""
    rng = np.random.default_rng(seed + 1000)
    points = np.column_stack([lattice(BOARD), np.zeros(135)])
    views = []
    for i, (rotation, translation) in enumerate(poses or board_poses(count, seed)):
        uv = project(points @ rotation.T + translation, squeeze)
        views.append(Corners(f"view{i}.png", np.arange(135), uv + noise * rng.normal(size=uv.shape)))
    return CornerSet(BOARD, SIZE, tuple(views))
