"""Learnt maps: accuracy, uncertainty by Monte Carlo, and the choice of the trend."""

import numpy as np
import pytest

from pinholify.errors import CalibrationError
from pinholify.gp.fitting import fit_map
from pinholify.gp.kernels import KERNELS

LATTICE = np.stack(np.meshgrid(np.arange(15.0), np.arange(9.0)), -1).reshape(-1, 2)
CENTRE = np.array([960.0, 600.0])
NOISE = 0.1


def barrel(lattice, bumps=0.0):
    """Pixels of lattice points seen through barrel distortion, and bumps of so many px that no trend knows."""
    d = (lattice - [7.0, 4.0]) / 8.0
    bent = d * (1 - 0.08 * (d**2).sum(axis=1, keepdims=True))
    shift = np.stack([np.sin(5 * d[:, 0]) * np.cos(4 * d[:, 1]), np.cos(4 * d[:, 0] + 1) * np.sin(5 * d[:, 1])], axis=1)
    return CENTRE + 900.0 * bent + bumps * shift


def inside_points():
    rng = np.random.default_rng(9)
    return rng.uniform([0.5, 0.5], [13.5, 7.5], (60, 2))


def noisy(seed, bumps=0.0):
    return barrel(LATTICE, bumps) + NOISE * np.random.default_rng(seed).normal(size=LATTICE.shape)


def error_px(fitted, lattice, bumps=0.0):
    uv = barrel(lattice, bumps)
    error = np.linalg.solve(fitted.map.jacobian(uv), (fitted.map.value(uv) - lattice)[:, :, None])[:, :, 0]
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def test_a_lens_is_chosen_for_a_lens_and_maps_finer_than_the_noise():
    fitted = fit_map(noisy(0), LATTICE)
    assert fitted.trend.startswith("lens")
    assert error_px(fitted, inside_points()) < 0.045
    assert fitted.noise == pytest.approx(NOISE, rel=0.15)
    assert dict(fitted.candidates)[fitted.trend] == fitted.log_evidence == max(v for _, v in fitted.candidates)


def test_the_gp_finds_what_no_trend_has():
    with_gp = fit_map(noisy(0, bumps=2.0), LATTICE)
    assert error_px(with_gp, inside_points(), bumps=2.0) < 0.12
    assert with_gp.noise == pytest.approx(NOISE, rel=0.25)


def test_the_papers_constant_mean_maps_too():
    fitted = fit_map(noisy(0), LATTICE, trend="constant")
    assert fitted.trend == "constant"
    assert error_px(fitted, inside_points()) < 0.2


@pytest.mark.parametrize("kernel", KERNELS)
def test_every_kernel_fits(kernel):
    fitted = fit_map(noisy(0), LATTICE, kernel=kernel, trend="lens:2")
    assert error_px(fitted, inside_points()) < 0.08


@pytest.mark.parametrize("trend", ["constant", "homography", "lens:2", "polynomial:3"])
def test_jacobian_and_inverse_belong_to_the_map(trend):
    plane_map = fit_map(noisy(0), LATTICE, trend=trend).map
    uv, h = barrel(inside_points()), 0.3
    numeric = [(plane_map.value(uv + e) - plane_map.value(uv - e)) / (2 * h) for e in np.eye(2) * h]
    np.testing.assert_allclose(plane_map.jacobian(uv), np.stack(numeric, -1), atol=2e-6)
    np.testing.assert_allclose(plane_map.inverse(plane_map.value(uv), lambda _: (uv + 3.0, 100.0)), uv, atol=2e-3)


@pytest.mark.parametrize("trend", ["constant", "lens:2"])
def test_the_evidence_is_a_density_of_pixels(trend):
    """The same photograph at twice the resolution has the density of half-size pixels: 2N log 2 less."""
    uv = noisy(0)
    once, twice = fit_map(uv, LATTICE, trend=trend), fit_map(2.0 * uv, LATTICE, trend=trend)
    assert twice.log_evidence == pytest.approx(once.log_evidence - uv.size * np.log(2.0), abs=0.5)
    assert twice.noise == pytest.approx(2.0 * once.noise, rel=0.02)


def test_a_doubted_corner_counts_less():
    uv = noisy(0)
    uv[70] += [6.0, -4.0]
    doubt = np.ones(len(uv))
    doubt[70] = 100.0
    assert error_px(fit_map(uv, LATTICE, trend="lens:3", relative_noise=doubt), inside_points()) < 0.045
    assert error_px(fit_map(uv, LATTICE, trend="lens:3"), inside_points()) > 0.1


@pytest.mark.parametrize("trend", ["constant", "lens:3"])
def test_the_response_to_new_noise_is_that_of_fitting_anew(trend):
    uv = barrel(inside_points())
    anew = np.array([fit_map(noisy(seed), LATTICE, trend=trend).map.value(uv) for seed in range(30)])
    response = fit_map(noisy(99), LATTICE, trend=trend).map.noise_response(uv, 400, np.random.default_rng(0))
    ratio = np.sqrt((response.std(axis=0) ** 2).mean() / (anew.std(axis=0, ddof=1) ** 2).mean())
    assert ratio == pytest.approx(1.0, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(("trend", "bumps"), [("lens:3", 0.0), ("lens:3", 1.0)])
def test_the_predicted_uncertainty_is_the_sampled_one(trend, bumps):
    """Mean squared error over noise draws against the predicted variance, pooled over the board."""
    at = inside_points()
    uv = barrel(at, bumps)
    squared, predicted = [], []
    for seed in range(60):
        plane_map = fit_map(noisy(seed, bumps), LATTICE, trend=trend).map
        squared.append(((plane_map.value(uv) - at) ** 2).mean())
        predicted.append(np.trace(plane_map.covariance(uv), axis1=1, axis2=2).mean() / 2)
    assert np.sqrt(np.mean(predicted) / np.mean(squared)) == pytest.approx(1.0, rel=0.2)


def test_a_map_that_only_knows_its_corners_by_heart_is_none():
    rng = np.random.default_rng(0)
    xy = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    with pytest.raises(CalibrationError, match="no map of trend 'constant' fits the 54 corners"):
        fit_map(rng.uniform(0.0, 1000.0, xy.shape), xy, trend="constant")


def test_a_wide_lens_on_few_corners_is_fitted_though_the_constant_mean_is_not():
    xy = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    x, y = (xy - [4.0, 2.5]).T
    radius = np.hypot(x, y)
    uv = 560.0 * np.column_stack([x, y]) * (np.arctan2(radius, 1.3) / radius)[:, None] + [800.0, 600.0]
    found = fit_map(uv + np.random.default_rng(0).normal(0.0, 0.1, uv.shape), xy)
    assert "constant" not in dict(found.candidates)
    assert found.noise < 0.3


LINE = np.outer(np.arange(12.0), [1.0, 0.5])
HOPELESS = {
    "no point": (LATTICE[:0], LATTICE[:0]),
    "one point": (LATTICE[:1], LATTICE[:1]),
    "three points": (np.array([[0.0, 0], [90, 0], [0, 90]]), np.array([[0.0, 0], [1, 0], [0, 1]])),
    "a line in the image": (100.0 * LINE, LATTICE[[*range(6), *range(15, 21)]]),
    "a line on the board": (100.0 * LATTICE[[*range(6), *range(15, 21)]], LINE),
    "a line on both": (100.0 * LINE, LINE),
    "one place": (np.ones((12, 2)), np.ones((12, 2))),
    "nan": (np.full((12, 2), np.nan), LATTICE[[*range(6), *range(15, 21)]]),
}


@pytest.mark.parametrize("trend", ["auto", "constant", "homography", "lens:1"])
@pytest.mark.parametrize("name", HOPELESS)
def test_points_that_determine_no_map_are_refused_in_a_sentence(name, trend):
    with pytest.raises(CalibrationError, match="do not determine a map, which needs 4 or more"):
        fit_map(*HOPELESS[name], trend=trend)
