"""Charts: coordinates and rays are each other's inverse, and derivatives are right."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.charts import AngleChart, Intrinsics, PlaneChart

K = Intrinsics(4.0, 7.0, 4.0)
CHARTS = [PlaneChart(K), AngleChart(Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), K)]


def coordinates():
    q = np.random.default_rng(0).normal(size=(40, 2))
    q[:4] = [[0, 0], [1e-7, 0], [2e-4, -1e-4], [7e-4, 6e-4]]
    return q


@pytest.mark.parametrize("chart", CHARTS, ids=lambda c: type(c).__name__)
def test_coordinates_undo_directions(chart):
    q = coordinates()
    directions = chart.directions(q)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(chart.coordinates(3.0 * directions), q, atol=1e-12)


@pytest.mark.parametrize("chart", CHARTS, ids=lambda c: type(c).__name__)
def test_derivatives_are_those_of_central_differences(chart):
    q, h = coordinates(), 1e-6
    xyz = 2.0 * chart.directions(q)
    by_q = [(chart.directions(q + e) - chart.directions(q - e)) / (2 * h) for e in np.eye(2) * h]
    by_xyz = [(chart.coordinates(xyz + e) - chart.coordinates(xyz - e)) / (2 * h) for e in np.eye(3) * h]
    np.testing.assert_allclose(chart.direction_jacobian(q), np.stack(by_q, -1), atol=1e-8)
    np.testing.assert_allclose(chart.coordinate_jacobian(xyz), np.stack(by_xyz, -1), atol=1e-7)


def test_angles_go_beyond_a_right_angle_and_the_plane_does_not():
    behind = np.array([[1.0, 0.0, -0.5]])
    angles = AngleChart(np.eye(3), K).coordinates(behind)
    assert angles[0, 0] == pytest.approx(np.pi / 2 + np.arctan(0.5))
    assert np.isnan(CHARTS[0].coordinates(behind)).all()


def test_straight_behind_there_is_no_angle():
    assert np.isnan(AngleChart(np.eye(3), K).coordinates(np.array([[0.0, 0.0, -1.0]]))).all()


def test_rays_know_how_well_k_is_known():
    """Draws of K: the pixel that sees a fixed ray moves by as much as the chart's covariance says."""
    k, covariance = np.array([4.0, 7.0, 4.0]), np.diag([0.02, 0.01, 0.015]) ** 2
    covariance[0, 1] = covariance[1, 0] = 1e-4
    q = np.array([[7.0, 4.0], [12.0, 1.0], [3.0, 9.0]])
    chart = PlaneChart(Intrinsics(*k), covariance)
    draws = np.random.default_rng(0).multivariate_normal(k, covariance, 4000)
    seen = np.stack([PlaneChart(Intrinsics(*draw)).coordinates(chart.directions(q)) for draw in draws])
    sampled = np.stack([np.cov(seen[:, i], rowvar=False) for i in range(3)])
    np.testing.assert_allclose(chart.covariance(q), sampled, atol=0.08 * sampled.max())
    assert not PlaneChart(Intrinsics(*k)).covariance(q).any()


def test_virtual_points_depend_on_k_as_their_derivative_says():
    k, xyz, h = np.array([4.0, 7.0, 4.0]), np.array([[1.0, -2.0, 3.0], [0.5, 0.1, 2.0], [0.5, 0.1, -2.0]]), 1e-6
    by_k = [(Intrinsics(*(k + e)).project(xyz) - Intrinsics(*(k - e)).project(xyz)) / (2 * h) for e in np.eye(3) * h]
    found = Intrinsics(*k).parameter_jacobian(xyz)
    np.testing.assert_allclose(found[:2], np.stack(by_k, -1)[:2], atol=1e-8)
    assert np.isnan(found[2, :, 0]).all()
