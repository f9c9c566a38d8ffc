"""A camera whose reference board stands askew, so that its camera view is turned against the board's frame."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.board import Checkerboard, lattice
from pinholify.calibration.result import Calibration
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import Intrinsics, PlaneChart
from pinholify.corners import Corners, CornerSet
from pinholify.geometry import Pose, convex_hull
from pinholify.gp.fitting import fit_map
from pinholify.simulation.lenses import BrownConrady
from pinholify.simulation.views import true_corners, virtual_camera

BOARD, IMAGE_SIZE = Checkerboard(9, 6), (640, 480)
LENS = BrownConrady(IMAGE_SIZE, (420.0, 420.0), (6.0, -4.0), (-0.18, 0.03, 0.0))
MIDDLE = lattice(BOARD).mean(axis=0)
ROTATION = Rotation.from_euler("xyz", [12, -15, 4], degrees=True).as_matrix()
POSE = Pose(ROTATION, np.array([0.2, -0.1, 6.5]) - ROTATION[:, :2] @ MIDDLE)
"""The reference board before the true camera."""


def tilted_calibration() -> Calibration:
    """One noisy view makes the map; K is the true one."""
    uv = true_corners(LENS, BOARD, POSE) + np.random.default_rng(0).normal(0, 0.05, (54, 2))
    fitted = fit_map(uv, lattice(BOARD), kernel="se", trend="lens:2")
    intrinsics = Intrinsics(*virtual_camera(POSE))
    domain = Domain(convex_hull(uv))
    camera = VirtualCamera(fitted.map, PlaneChart(intrinsics), domain, IMAGE_SIZE, fitted.noise)
    corners = CornerSet(BOARD, IMAGE_SIZE, (Corners("a.png", np.arange(54), uv),))
    return Calibration(camera, corners, "one-image", "se", fitted.trend, "a.png", np.zeros(3))
