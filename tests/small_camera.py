"""The small camera that the tests of the command line share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinholify.board import Checkerboard, lattice
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import Intrinsics, PlaneChart
from pinholify.corners import Corners, CornerSet
from pinholify.geometry import Pose, convex_hull
from pinholify.gp.fitting import fit_map
from pinholify.simulation.datasets import Dataset
from pinholify.simulation.lenses import BrownConrady
from pinholify.simulation.photograph import Sensor
from pinholify.simulation.views import board_poses, true_corners, virtual_camera

BOARD = Checkerboard(9, 6)
SIZE = (640, 480)
LENS = BrownConrady(SIZE, (420.0, 420.0), (6.0, -4.0), (-0.18, 0.03, 0.0))
SMALL = Dataset("small", "A small camera", LENS, BOARD, 7, Sensor(shot_noise=1.0, read_noise=1.0), 3, {})
FROM_TABLE = ("--board", "9x6", "--image-size", "640x480", "--trend", "lens:1", "--no-opencv")


def corner_set(poses: Sequence[Pose], *, noise: float = 0.05, lens: BrownConrady = LENS) -> CornerSet:
    """Noisy corners of ``poses`` as the small camera sees them, named a0.png, a1.png, …"""
    rng = np.random.default_rng(0)
    views = []
    for i, pose in enumerate(poses):
        uv = true_corners(lens, BOARD, pose)
        views.append(Corners(f"a{i}.png", np.arange(len(uv)), uv + rng.normal(0, noise, uv.shape)))
    return CornerSet(BOARD, SIZE, tuple(views))


def quick_camera() -> VirtualCamera:
    """The small camera as one noisy view of a board that fills the frame shows it; K is the true one."""
    pose = board_poses((LENS,), BOARD, 1, seed=3)[0]
    uv = corner_set([pose]).views[0].uv
    fitted = fit_map(uv, lattice(BOARD), kernel="se", trend="lens:2")
    intrinsics = Intrinsics(*virtual_camera(pose))
    return VirtualCamera(fitted.map, PlaneChart(intrinsics), Domain(convex_hull(uv)), SIZE, fitted.noise)
