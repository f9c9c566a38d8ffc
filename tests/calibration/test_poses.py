"""Least squares of poses and K: derivatives against central differences, exact recovery from a poor start."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.board import Checkerboard, lattice
from pinholify.calibration.poses import (
    Sighting,
    influence_on_intrinsics,
    moved,
    pose_residuals,
    refine_intrinsics,
    refine_pose,
)
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


@pytest.mark.parametrize("chart", [PlaneChart(K), AngleChart(np.eye(3), K)], ids=["plane", "angles"])
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


def noisy_boards(count, seed, noise=1e-3):
    """Sightings of ``count`` boards at random, and the poses: each coordinate ``noise`` squares off, 0.2 px."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_euler("xyz", rng.uniform(-30, 30, (count, 3)), degrees=True).as_matrix()
    poses = [Pose(turn, np.array([-3.0, -2.0, 11.0]) + rng.uniform(-1, 1, 3)) for turn in turns]
    exact = [sighting(pose, PlaneChart(K)) for pose in poses]
    return [replace(s, coordinates=s.coordinates + noise * rng.normal(size=(54, 2))) for s in exact], poses


def refined(seen, poses):
    found = refine_intrinsics(seen, K, poses)
    return np.array([found.intrinsics.f, found.intrinsics.uc, found.intrinsics.vc]), found


def test_the_response_of_k_to_a_corner_is_that_of_fitting_anew():
    seen, poses = noisy_boards(5, 0)
    k, found = refined(seen, poses)
    responses = influence_on_intrinsics(seen, found.intrinsics, found.poses).responses
    for board, corner, axis in ((0, 0, 0), (3, 17, 1), (4, 53, 0)):
        shifted = seen[board].coordinates.copy()
        shifted[corner, axis] += 1e-3
        anew = [*seen[:board], replace(seen[board], coordinates=shifted), *seen[board + 1 :]]
        np.testing.assert_allclose(
            (refined(anew, poses)[0] - k) / (1e-3 * 200.0), responses[board][:, 2 * corner + axis], rtol=0.03, atol=2e-6
        )


def test_leaving_out_a_board_moves_k_as_it_says():
    seen, poses = noisy_boards(8, 1)
    k, found = refined(seen, poses)
    left_out = influence_on_intrinsics(seen, found.intrinsics, found.poses).left_out
    for i in range(8):
        anew = refined(seen[:i] + seen[i + 1 :], poses[:i] + poses[i + 1 :])[0]
        np.testing.assert_allclose(anew - k, left_out[i], rtol=0.1, atol=1e-5)


def test_the_jackknife_is_the_spread_of_k():
    poses = noisy_boards(12, 2)[1]
    exact = [sighting(pose, PlaneChart(K)) for pose in poses]
    found, predicted = [], []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        seen = [replace(s, coordinates=s.coordinates + 1e-3 * rng.normal(size=(54, 2))) for s in exact]
        k, at = refined(seen, poses)
        found.append(k)
        predicted.append(influence_on_intrinsics(seen, at.intrinsics, at.poses).jackknife_std)
    ratio = np.sqrt(np.mean(np.square(predicted), axis=0)) / np.std(found, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.45)  # a jackknife over 12 unlike boards is a little generous
    assert influence_on_intrinsics(exact[:3], K, poses[:3]).jackknife_std is None
