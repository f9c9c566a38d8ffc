"""Spline surfaces: another library's B-splines, recovery of what was a spline, and straight continuation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from pinholify.splines import SplineMap, SplineSurface, fitted, rounded_up, worst_places

ORIGIN, SPACING = np.array([1.0, -2.0]), np.array([0.5, 0.7])


def surface(degree, seed=0, shape=(7, 8, 2)):
    return SplineSurface(ORIGIN, SPACING, np.random.default_rng(seed).normal(size=shape), degree)


def inside(count, degree, seed=1):
    """Points (count, 2) of the patches of :func:`surface`."""
    first = (degree - 1) / 2.0
    place = np.random.default_rng(seed).uniform(first, np.array([7, 6]) - first, (count, 2))
    return ORIGIN + SPACING * place


@pytest.mark.parametrize("degree", [2, 3])
def test_values_are_those_of_scipy(degree):
    """The same surface as a tensor product of scipy's B-splines, whose knots begin half their support earlier."""
    ours, p = surface(degree), inside(200, degree)
    place = (p - ORIGIN) / SPACING + (degree + 1) / 2.0
    sides = zip(place.T, (8, 7), strict=True)
    x, y = (BSpline.design_matrix(q, np.arange(n + degree + 1.0), degree).toarray() for q, n in sides)
    np.testing.assert_allclose(ours.value(p), np.einsum("ni,nj,ijm->nm", y, x, ours.control), atol=1e-12)


@pytest.mark.parametrize("degree", [2, 3])
def test_jacobian_is_the_difference(degree):
    """Beyond the patches too."""
    ours, p = surface(degree), inside(50, degree) * 1.5
    steps = [(ours.value(p + e) - ours.value(p - e)) / 2e-6 for e in 1e-6 * np.eye(2)]
    np.testing.assert_allclose(ours.jacobian(p), np.stack(steps, axis=2), atol=1e-6)


@pytest.mark.parametrize("degree", [2, 3])
def test_beyond_the_patches_the_polynomial_goes_on(degree):
    """A polynomial of the spline's own degree along a line stays one: its next difference vanishes across the end."""
    line = np.linspace(4.2, 6.0, 12)[:, None] * [1.0, 0.0] + [0.0, 0.1]
    values = surface(degree).value(line)
    assert np.abs(np.diff(values, degree + 1, axis=0)).max() < 1e-10


@pytest.mark.parametrize("degree", [2, 3])
def test_a_fit_finds_the_spline_that_made_the_data(degree):
    truth, p = surface(degree), inside(3000, degree)
    empty = SplineSurface(ORIGIN, SPACING, np.zeros_like(truth.control), degree)
    found = fitted(empty, p, truth.value(p))
    # Control points as rough as noise of std 1 are the hardest: what holds the surface straight takes this much.
    assert np.abs(found.value(p) - truth.value(p)).max() < 1e-5


def test_where_there_are_no_data_a_fit_goes_on_straight():
    def plane(p):
        return p @ np.array([[1.0, 2.0], [3.0, -1.0]]) + 0.5

    p = inside(400, 3)
    p = p[p[:, 0] < 2.5]
    found = fitted(SplineSurface(ORIGIN, SPACING, np.zeros((7, 8, 2))), p, plane(p))
    elsewhere = inside(50, 3, seed=2)
    assert np.abs(found.value(elsewhere) - plane(elsewhere)).max() < 1e-5


def test_impossible_surfaces_are_refused():
    with pytest.raises(ValueError, match="degree 4"):
        surface(4)
    with pytest.raises(ValueError, match="too few"):
        surface(3, shape=(7, 3, 2))


@settings(max_examples=40)
@given(seed=st.integers(0, 1000), std=st.floats(1e-6, 10.0))
def test_a_map_is_inverted_and_knows_its_std(seed, std):
    rng = np.random.default_rng(seed)
    bent = rng.normal(0, 0.03, (7, 8, 2))
    where = np.stack(np.meshgrid(np.arange(8.0), np.arange(7.0)), axis=-1)
    ours = SplineMap(SplineSurface(ORIGIN, SPACING, where + bent), std)
    p = inside(40, 3, seed)
    found = ours.inverse(ours.value(p), lambda _: (p + rng.normal(0, 0.05, p.shape), 0.5))
    np.testing.assert_allclose(found, p, atol=1e-7)
    # The covariance is of a shift of the pixel by std along each axis.
    back = np.linalg.inv(ours.jacobian(p))
    expected = np.broadcast_to(std**2 * np.eye(2), (40, 2, 2))
    np.testing.assert_allclose(back @ ours.covariance(p) @ back.transpose(0, 2, 1), expected, atol=1e-12 * std**2)
    assert ours.noise_response(p, 3, rng).shape == (3, 40, 2)


def test_the_worst_place_is_found_between_those_of_a_grid():
    def error(p):
        inside = np.linalg.norm(p - 5.0, axis=1) < 3.83
        bumps = np.exp(-(((p - [3.37, 4.61]) / 0.4) ** 2).sum(axis=1))
        return np.where(inside, bumps + np.maximum(p[:, 0] - 8.0, 0.0), np.nan)

    grid = np.stack(np.meshgrid(np.arange(11.0), np.arange(11.0)), axis=-1).reshape(-1, 2)
    found = error(worst_places(error, grid, 1.0))
    assert np.nanmax(error(grid)) < 0.4
    assert 0.999 < np.nanmax(found) <= 1.0
    # Where the error rises to the border of what counts, it is followed to there.
    steep = np.nanmax(error(worst_places(lambda p: np.where(p[:, 0] > 7.0, error(p), np.nan), grid, 1.0)))
    assert 0.82 < steep <= 0.83


@pytest.mark.parametrize(("value", "text"), [(0.0441, "0.045"), (0.044, "0.044"), (1.01e-5, "1.1e-05"), (0.99999, "1"),
                                             (9.91, "10"), (2e-3, "0.002")])  # fmt: skip
def test_a_bound_is_never_rounded_down(value, text):
    assert rounded_up(value) == text
