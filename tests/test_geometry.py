"""Plane geometry against OpenCV, scipy and analytic cases."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pinholify.geometry import (
    apply_homography,
    convex_hull,
    estimate_homography,
    homography_jacobian,
    homography_parameter_jacobian,
    homography_response,
    image_grid,
    inverse_2x2,
    line_distances,
    nearest_rotation,
    rotation_about_z,
    rotation_to_z,
    solve_2x2,
)

H = np.array([[1.2, 0.1, 3.0], [-0.2, 0.9, -1.0], [0.01, -0.02, 1.0]])


def scattered(count=40, seed=0):
    return np.random.default_rng(seed).uniform(0, 10, (count, 2))


def test_an_exact_homography_is_recovered():
    p = scattered()
    np.testing.assert_allclose(estimate_homography(p, apply_homography(H, p)), H, atol=1e-10)


def test_a_noisy_homography_is_opencvs():
    p = scattered()
    q = apply_homography(H, p) + 0.05 * np.random.default_rng(1).normal(size=p.shape)
    theirs, _ = cv2.findHomography(p, q, 0)
    ours = estimate_homography(p, q)
    cost = [((apply_homography(h, p) - q) ** 2).sum() for h in (ours, theirs)]
    assert cost[0] <= cost[1] * (1 + 1e-9)
    np.testing.assert_allclose(ours, theirs, rtol=2e-3, atol=1e-3)


def test_whitening_makes_doubtful_points_count_less():
    p = scattered()
    q = apply_homography(H, p)
    q[0] += 5.0
    trust = np.broadcast_to(np.eye(2), (40, 2, 2)).copy()
    trust[0] *= 1e-6
    np.testing.assert_allclose(estimate_homography(p, q, trust), H, atol=1e-6)


def test_too_few_points_are_refused():
    with pytest.raises(ValueError, match="4 points"):
        estimate_homography(scattered(3), scattered(3))


def test_derivatives_of_a_homography():
    p, h = scattered(10), 1e-6
    numeric = [(apply_homography(H, p + e) - apply_homography(H, p - e)) / (2 * h) for e in np.eye(2) * h]
    np.testing.assert_allclose(homography_jacobian(H, p), np.stack(numeric, -1), atol=1e-7)
    entries = h * np.eye(9).reshape(9, 3, 3)
    numeric = [(apply_homography(H + e, p) - apply_homography(H - e, p)) / (2 * h) for e in entries]
    np.testing.assert_allclose(homography_parameter_jacobian(H, p), np.stack(numeric, -1), atol=1e-6)
    q, whitening = apply_homography(H, p), np.broadcast_to(np.eye(2), (10, 2, 2))
    response = homography_response(H, p, whitening)
    for i in (0, 7, 19):
        moved = q.ravel().copy()
        moved[i] += 1e-5
        change = (estimate_homography(p, moved.reshape(-1, 2)) - H).ravel() / 1e-5
        np.testing.assert_allclose(response[:, i], change, atol=1e-4)


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_a_hull_contains_its_points_and_has_opencvs_area(seed):
    p = scattered(30, seed)
    hull = convex_hull(p)
    assert hull.contains(p).all()
    assert not hull.contains(np.array([[-1.0, 5.0], [11.0, 5.0]])).any()
    assert hull.area == pytest.approx(cv2.contourArea(cv2.convexHull(p.astype(np.float32))), rel=1e-4)


def test_points_on_a_line_have_no_hull():
    hull = convex_hull(np.column_stack([np.arange(5.0), np.arange(5.0)]))
    assert hull.area == 0
    assert not hull.contains(np.array([[1.0, 1.0]])).any()


def test_distances_to_a_steep_line_are_perpendicular():
    t = np.linspace(-3, 3, 9)
    offsets = np.array([1, -1, 1, -1, 0, -1, 1, -1, 1]) * 0.01
    line = np.outer(t, [0.1, 1.0]) + np.outer(offsets, [1.0, -0.1]) / np.hypot(1, 0.1)
    np.testing.assert_allclose(line_distances(line), np.abs(offsets), atol=2e-3)


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_the_nearest_rotation_is_one(seed):
    r = nearest_rotation(np.random.default_rng(seed).normal(size=(3, 3)))
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(r) == pytest.approx(1.0)


def test_the_nearest_rotations_of_many_matrices_are_those_of_each():
    matrices = np.random.default_rng(0).normal(size=(10, 3, 3))
    np.testing.assert_allclose(nearest_rotation(matrices), [nearest_rotation(m) for m in matrices], atol=1e-12)


def test_a_rotation_about_z_is_scipys():
    np.testing.assert_allclose(rotation_about_z(-0.3), Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix(), atol=1e-14)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.36, 0.48, -0.8), (1e-9, 0.0, -1.0)])
def test_a_direction_is_turned_to_z(direction):
    turn = rotation_to_z(np.array(direction))
    np.testing.assert_allclose(turn @ direction, [0.0, 0.0, 1.0], atol=1e-8)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_two_by_two_systems_are_solved():
    rng = np.random.default_rng(2)
    matrices, right = rng.normal(size=(50, 2, 2)), rng.normal(size=(50, 2))
    np.testing.assert_allclose(
        solve_2x2(matrices, right), np.linalg.solve(matrices, right[:, :, None])[:, :, 0], rtol=1e-8
    )
    np.testing.assert_allclose(inverse_2x2(matrices), np.linalg.inv(matrices), rtol=1e-8)
    assert np.isnan(solve_2x2(np.zeros((1, 2, 2)), np.zeros((1, 2)))).all()


def test_a_grid_of_an_image_ends_at_the_outermost_pixels_or_the_edges():
    np.testing.assert_array_equal(image_grid((5, 3), 2), [[0, 0], [4, 0], [0, 2], [4, 2]])
    np.testing.assert_array_equal(image_grid((5, 3), 2, to_edges=True)[[0, -1]], [[-0.5, -0.5], [4.5, 2.5]])
    np.testing.assert_array_equal(image_grid((5, 3), 3)[1], [2, 0])
