from itertools import product

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinholify.errors import InputError
from pinholify.refinement.trends import FAMILIES, Angles, LensTrend, Plane, RayChart, Trend, searches_named
from pinholify.refinement.trends.fitting import fit_trend, levelling_rotation
from pinholify.refinement.trends.polynomial import PolynomialTrend
from pinholify.refinement.trends.radial import Radial, tangent_law

TRENDS = [trend for build in FAMILIES.values() for search in build(3) for trend in search.within]
TRENDS += sorted({t.around().general for t in TRENDS if isinstance(t, LensTrend)}, key=lambda trend: trend.name)
FLAGS = list(product((False, True), repeat=6))
HALF = np.array([0.8, 0.6])


def example(trend: Trend, size: float = 0.02) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """β, w and c that belong together."""
    rng = np.random.default_rng(3)
    w = rng.uniform(-1, 1, (40, 2)) * HALF
    beta = trend.start(w, 0.8 * w) + rng.normal(0, size, len(trend.prior_std))
    return beta, w, trend.ray(beta, w)


@pytest.mark.parametrize("trend", TRENDS, ids=lambda trend: trend.name)
def test_image_undoes_ray(trend: Trend) -> None:
    beta, w, c = example(trend)
    np.testing.assert_allclose(trend.image(beta, c, w + 0.01), w, atol=1e-10)


@pytest.mark.parametrize("trend", TRENDS, ids=lambda trend: trend.name)
def test_jacobians(trend: Trend) -> None:
    check_jacobians(trend)


@pytest.mark.parametrize("order", [0, 2])
@pytest.mark.parametrize("distorting", [False, True])
@pytest.mark.parametrize("chart", [Plane(), Angles()])
def test_jacobians_of_every_combination_of_parameters(chart: RayChart, distorting: bool, order: int) -> None:
    for flags in FLAGS:
        check_jacobians(LensTrend(chart, distorting, order, *flags))


def check_jacobians(trend: Trend) -> None:
    beta, w, c = example(trend)
    by_ray, by_beta = trend.jacobians(beta, w, c)
    for i, h in enumerate(1e-6 * np.eye(2)):
        numeric = (trend.image(beta, c + h, w) - trend.image(beta, c - h, w)) / 2e-6
        np.testing.assert_allclose(by_ray[:, :, i], numeric, atol=1e-7)
    for i, h in enumerate(1e-6 * np.eye(len(beta))):
        numeric = (trend.image(beta + h, c, w) - trend.image(beta - h, c, w)) / 2e-6
        np.testing.assert_allclose(by_beta[:, :, i], numeric, atol=1e-7)


@pytest.mark.parametrize("build", FAMILIES.values(), ids=FAMILIES.keys())
def test_a_smaller_trend_is_the_general_one_with_the_others_at_zero(build) -> None:
    for search in build(None):
        for general, within in ((s.general, s.within) for s in (search, search.within[0].around())):
            for trend in within:
                beta, w, _ = example(trend)
                kept = general.kept(trend)
                padded = np.zeros(len(general.prior_std))
                padded[kept] = beta
                np.testing.assert_allclose(general.ray(padded, w), trend.ray(beta, w), atol=1e-13)
                np.testing.assert_array_equal(general.prior_std[kept], trend.prior_std)


def test_names_are_unique() -> None:
    names = [trend.name for stage in searches_named("auto") for search in stage for trend in search.within]
    assert len(names) == len(set(names))


def test_decentring_and_prism_are_opencvs() -> None:
    """OpenCV's p₁ belongs to y and its p₂ to x; s₁ and s₃ are a prism's."""
    radial = Radial(0.0, 0.0, np.array([-0.2, 0.05]), np.array([-0.003, 0.004]), np.array([0.002, -0.001]))
    d = np.random.default_rng(0).uniform(-0.7, 0.7, (30, 2))
    xyz = np.column_stack([d, np.ones(30)])
    distortion = np.array([-0.2, 0.05, 0.004, -0.003, 0, 0, 0, 0, 0.002, 0, -0.001, 0])
    seen, _ = cv2.projectPoints(xyz, np.zeros(3), np.zeros(3), np.eye(3), distortion)
    np.testing.assert_allclose(radial.value(d), seen[:, 0], atol=1e-12)
    np.testing.assert_allclose(radial.inverse(seen[:, 0]), d, atol=1e-12)


@given(st.floats(-3.0, 2.0), st.floats(0.0, 1.0))
@settings(deadline=None)
def test_tangent_law_and_its_slope(kappa: float, r: float) -> None:
    r2 = np.array([r**2])
    value, slope = tangent_law(kappa, r2)
    z = kappa * r**2
    exact = (
        1.0
        if z == 0
        else np.tan(np.sqrt(z + 0j)).real / np.sqrt(z + 0j).real
        if z > 0
        else (np.tanh(np.sqrt(-z)) / np.sqrt(-z))
    )
    np.testing.assert_allclose(value, exact, rtol=1e-9)
    h = 1e-5
    numeric = (
        (
            tangent_law(np.sign(kappa) or 1.0, abs(z) + np.array([h]))[0]
            - tangent_law(np.sign(kappa) or 1.0, abs(z) - np.array([h]))[0]
        )
        / (2 * h)
        * (np.sign(kappa) or 1.0)
    )
    np.testing.assert_allclose(slope, numeric, rtol=1e-4, atol=1e-6)


def test_tangent_law_in_angles_is_perspective_and_stereographic() -> None:
    theta = np.linspace(0.0, 1.2, 20)
    for kappa, radius in ((1.0, np.tan(theta)), (0.25, 2.0 * np.tan(theta / 2.0))):
        moved = Radial(0.0, kappa, np.empty(0), np.zeros(2), np.zeros(2)).value(np.column_stack([theta, 0 * theta]))
        np.testing.assert_allclose(moved[:, 0], radius, rtol=1e-12)


def test_radial_inverse_ends_where_the_radius_turns_back() -> None:
    radial = Radial(0.0, 0.0, np.array([-0.3]), np.zeros(2), np.zeros(2))  # r (1 − 0.3 r²) grows to 0.703
    inside, beyond = radial.inverse(np.array([[0.69, 0.0], [0.72, 0.0]]))
    assert np.isfinite(inside).all()
    assert np.isnan(beyond).all()


def test_a_trend_that_folds_in_the_image_is_refused() -> None:
    trend = LensTrend(Plane(), False, 1, anisotropic=False, tilted=False, elliptic=False, tangent=False)
    assert trend.folds(np.array([1.0, 0.0, 0.0, -0.4]), HALF[None])
    assert not trend.folds(np.array([1.0, 0.0, 0.0, -0.2]), HALF[None])
    assert trend.folds(np.array([-1.0, 0.0, 0.0, 0.0]), HALF[None])


def test_fit_trend_finds_the_parameters() -> None:
    trend = LensTrend(Angles(), True, 2, tangent=False)
    beta, w, c = example(trend)
    found = fit_trend(trend, w, trend.chart.directions(c))
    assert found is not None
    np.testing.assert_allclose(trend.image(found, c, w), w, atol=1e-5)
    np.testing.assert_allclose(found[0], beta[0], rtol=0.05)


def test_levelling_rotation_takes_out_turn_and_roll() -> None:
    from scipy.spatial.transform import Rotation

    w = np.random.default_rng(0).uniform(-1, 1, (400, 2)) * HALF
    turn = Rotation.from_rotvec([0.2, 0.3, 0.5]).as_matrix()
    rays = Angles().directions(1.1 * w) @ turn.T
    np.testing.assert_allclose(levelling_rotation(w, rays) @ turn, np.eye(3), atol=1e-4)


@pytest.mark.parametrize("name", ["round", "plane:x", "plane:99", "plane:²", "polynomial:0"])
def test_unknown_trend_is_named_with_those_there_are(name: str) -> None:
    with pytest.raises(InputError, match="plane, angle"):
        searches_named(name)


def test_a_strong_lens_is_fitted_from_a_trend_that_holds_it() -> None:
    """A linear start runs into another minimum here; the same lens with numbers more, or less, does not."""
    beta = np.array([1.2, -0.26, 0.15, -0.29, 0.16, 0.575, 0.916])
    general = LensTrend(Plane(), True, 1, decentred=True, prismatic=True)
    strong = LensTrend(Plane(), True, 0, anisotropic=False)
    w = np.random.default_rng(0).uniform(-1, 1, (200, 2)) * [0.78, 0.44]
    rays = strong.chart.directions(strong.ray(beta, w))
    more = general.resembling(strong, beta)
    assert more is not None
    np.testing.assert_array_equal(more[general.kept(strong)], beta)
    assert np.count_nonzero(more) == len(beta)
    np.testing.assert_array_equal(strong.resembling(general, more), beta)
    astray = fit_trend(strong, w, rays)
    assert astray is None or np.abs(strong.image(astray, strong.ray(beta, w), w) - w).max() > 1e-3
    found = fit_trend(strong, w, rays, strong.resembling(general, more + 1e-3))
    assert found is not None
    np.testing.assert_allclose(strong.image(found, strong.ray(beta, w), w), w, atol=1e-5)
    assert LensTrend(Angles(), True, 1).resembling(strong, beta) is None
    assert PolynomialTrend(3).resembling(strong, beta) is None


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kappa", [0.0, 0.5, -0.5])
def test_a_step_too_far_gives_no_finite_image_and_no_warning(kappa: float) -> None:
    radial = Radial(800.0, kappa, np.array([-0.1, 0.02]), np.zeros(2), np.zeros(2))
    assert not np.isfinite(radial.value(np.array([[0.3, 0.2], [-0.1, 0.4]]))).all(axis=1).any()
