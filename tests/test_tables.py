"""Tables of maps: within their tolerance of the exact map everywhere, and the map itself where they cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from pinholify.points import undistort_points, undistortion_table
from pinholify.tables import TILES, point_table

SIZE = (640, 400)


def bent(uv):
    return 3.0 * uv + 20.0 * np.sin(uv[:, ::-1] / 90.0)


def pixels(count=20_000):
    return np.random.default_rng(0).uniform(-0.5, np.array(SIZE) - 0.5, (count, 2))


def told(function):
    """The function, and how many points it has been asked for."""
    asked = []

    def counting(uv):
        asked.append(len(uv))
        return function(uv)

    return counting, asked


@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-5])
def test_a_table_keeps_its_tolerance(tolerance):
    exact, asked = told(bent)
    table = point_table(exact, SIZE, tolerance=tolerance)
    asked.clear()
    # Errors of the answer are three times those of the pixel here.
    assert np.abs(table(pixels()) - bent(pixels())).max() / 3.0 < 2.0 * tolerance
    assert sum(asked) < 0.01 * len(pixels())


def test_a_coarse_table_is_not_exact():
    error = np.abs(point_table(bent, SIZE, tolerance=1e-1)(pixels()) - bent(pixels())).max()
    assert error > 1e-4


def test_a_quadratic_is_exact_in_the_coarsest_table():
    def quadratic(uv):
        u, v = uv.T / 400.0
        return np.stack([1 + 2 * u - v + u * v - 3 * u**2 + v**2 * u**2, u - 5 * v + v**2 - u**2 * v], axis=1)

    table = point_table(quadratic, SIZE, tolerance=1e-9)
    assert (table.splits == 1).all()
    np.testing.assert_allclose(table(pixels()), quadratic(pixels()), atol=1e-12)


def test_cells_are_small_only_where_the_map_bends():
    def bump(uv):
        return uv + 4.0 * np.exp(-(((uv - [520.0, 90.0]) / 25.0) ** 2).sum(axis=1, keepdims=True))

    exact, asked = told(bump)
    table = point_table(exact, SIZE, of_answer=True)
    splits = table.splits.reshape(TILES, TILES)
    row, column = np.nonzero(splits > 1)
    place = np.column_stack([column + 0.5, row + 0.5]) * np.array(SIZE) / TILES
    assert 0.02 < (splits > 1).mean() < 0.3
    assert np.linalg.norm(place - [520.0, 90.0], axis=1).max() < 120.0
    assert sum(asked) < 30_000
    assert np.abs(table(pixels()) - bump(pixels())).max() < 1.5e-3


def test_a_smooth_map_is_asked_for_few_of_its_values():
    exact, asked = told(lambda uv: uv + 3.0 * np.sin(uv[:, ::-1] / 300.0))
    table = point_table(exact, SIZE)
    np.testing.assert_allclose(table(pixels()), exact(pixels()), atol=1e-3)
    assert asked == [24 * 24, len(pixels())]


def test_what_no_table_holds_is_asked_of_the_map():
    def kinked(uv):
        return uv + np.where(uv[:, :1] > 301.7, 5.0, 0.0) * [1.0, 0.0]

    exact, asked = told(kinked)
    table = point_table(exact, SIZE)
    asked.clear()
    np.testing.assert_allclose(table(pixels()), kinked(pixels()), atol=1e-9)
    assert 0 < sum(asked) < 0.02 * len(pixels())


def test_what_is_outside_or_does_not_exist():
    def half(uv):
        return np.where(uv[:, :1] + uv[:, 1:] < 500, uv, np.nan)

    table = point_table(half, SIZE)
    np.testing.assert_allclose(table(pixels()), half(pixels()), atol=1e-9)
    outside = np.array([[-50.0, 10.0], [10.0, 450.0], [np.nan, 5.0]])
    np.testing.assert_allclose(table(outside), [[-50.0, 10.0], [10.0, 450.0], [np.nan, np.nan]])


@pytest.mark.parametrize("shape", [(7, 2), (7, 1, 2), (1, 7, 2), (0, 2), (2,)])
def test_shapes_are_kept(shape):
    assert point_table(bent, SIZE)(np.full(shape, 30.0, dtype=np.float32)).shape == shape


def test_undistortion_within_a_thousandth_of_a_pixel(barrel_calibration):
    camera = barrel_calibration.camera
    matrix = np.array([[1000.0, 0, 960], [0, 1000, 600], [0, 0, 1]])
    table = undistortion_table(camera, P=matrix)
    uv = np.random.default_rng(1).uniform([-0.5, -0.5], [1919.5, 1199.5], (5_000, 2))
    exact = undistort_points(uv, camera, P=matrix)
    stretch = np.sqrt(np.linalg.det(camera.virtual_jacobian(uv))) * 1000.0 / camera.intrinsics.f
    assert (np.linalg.norm(table(uv) - exact, axis=1) / stretch).max() < 1.5e-3
