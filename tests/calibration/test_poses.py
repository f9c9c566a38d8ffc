"""Least squares of poses and K: derivatives against central differences, exact recovery from a poor start."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.board import Checkerboard, lattice
from pinholify.calibration.poses import Sighting, moved, pose_residuals, refine_intrinsics, refine_pose
from pinholify.charts import AngleChart, Intrinsics, PlaneChart
from pinholify.geometry import Pose

K = Intrinsics(5.0, 7.2, 3.9)
LATTICE = lattice(Checkerboard(9, 6))
SOLID = np.column_stack([LATTICE, 0.02 * LATTICE[:, 0] ** 2])
POSES = [
    Pose(Rotation.from_euler("xyz", turns, degrees=True).as_matrix(), shift)
    for turns, shift in (((20, -15, 5), (-3, -2, 9)), ((-25, 10, 0), (-5, -3, 11)), ((10, 30, -8), (-2, -3, 12)))
]


def sighting(pose, chart, target=LATTICE):
    return Sighting(target, chart.coordinates(pose.apply(target)), np.broadcast_to(200.0 * np.eye(2), (54, 2, 2)))


@pytest.mark.parametrize("chart", [PlaneChart(K), AngleChart(np.eye(3))], ids=["plane", "angles"])
@pytest.mark.parametrize("target", [LATTICE, SOLID], ids=["flat", "bent"])
def test_derivatives_by_the_pose(chart, target):
    seen, h = sighting(POSES[0], chart, target), 1e-6
    start = moved(POSES[0], np.array([0.02, -0.03, 0.01, 0.1, -0.1, 0.2]))
    numeric = [
        (pose_residuals(seen, moved(start, e), chart)[0] - pose_residuals(seen, moved(start, -e), chart)[0]) / (2 * h)
        for e in np.eye(6) * h
    ]
    np.testing.assert_allclose(pose_residuals(seen, start, chart)[1], np.stack(numeric, -1), atol=1e-4)


@pytest.mark.parametrize("target", [LATTICE, SOLID], ids=["flat", "bent"])
def test_a_pose_is_found_from_a_poor_start(target):
    start = moved(POSES[0], np.array([0.2, -0.15, 0.3, 0.5, -0.4, 1.0]))
    found, covariance = refine_pose(sighting(POSES[0], PlaneChart(K), target), start, PlaneChart(K))
    np.testing.assert_allclose(found.rotation, POSES[0].rotation, atol=1e-7)
    np.testing.assert_allclose(found.translation, POSES[0].translation, atol=1e-6)
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_k_is_found_with_the_poses_from_a_poor_start():
    seen = [sighting(pose, PlaneChart(K)) for pose in POSES]
    start = [moved(pose, np.array([0.03, -0.02, 0.04, 0.1, -0.1, 0.3])) for pose in POSES]
    found = refine_intrinsics(seen, Intrinsics(5.5, 7.0, 4.2), start)
    assert (found.intrinsics.f, found.intrinsics.uc, found.intrinsics.vc) == pytest.approx((5.0, 7.2, 3.9), abs=1e-6)
    for pose, true in zip(found.poses, POSES, strict=True):
        np.testing.assert_allclose(pose.translation, true.translation, atol=1e-5)
