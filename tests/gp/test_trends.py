"""Trends: derivatives, inverses, and that each can be what it is meant to be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinholify.errors import InputError
from pinholify.gp.trends import Homography, Lens, Polynomial, trends_named
from pinholify.gp.trends.base import inverse

ALL = [Homography(), Lens(1), Lens(3), Lens(6), Polynomial(3), Polynomial(5)]


def parameters(trend, rng):
    """A mildly bent map near the identity."""
    beta = trend.prior_mean + 0.02 * rng.normal(size=len(trend.prior_mean))
    identity = {1: 1.0, len(beta) // 2 + 2: 1.0, 2: 0.0} if isinstance(trend, Polynomial) else {0: 1.0, 4: 1.0}
    for i, value in identity.items():
        beta[i] = value
    return beta


@pytest.mark.parametrize("trend", ALL, ids=lambda t: t.name)
def test_derivatives_are_those_of_central_differences(trend):
    rng = np.random.default_rng(0)
    x, beta, h = rng.uniform(-1, 1, (20, 2)), parameters(trend, rng), 1e-6
    by_input = [(trend.value(beta, x + e) - trend.value(beta, x - e)) / (2 * h) for e in np.eye(2) * h]
    by_beta = [(trend.value(beta + e, x) - trend.value(beta - e, x)) / (2 * h) for e in np.eye(len(beta)) * h]
    np.testing.assert_allclose(trend.input_jacobian(beta, x), np.stack(by_input, -1), atol=1e-7)
    np.testing.assert_allclose(trend.parameter_jacobian(beta, x), np.stack(by_beta, -1), atol=1e-7)


@pytest.mark.parametrize("trend", ALL, ids=lambda t: t.name)
@given(seed=st.integers(0, 10**6))
@settings(max_examples=10, deadline=None)
def test_the_inverse_undoes_the_trend(trend, seed):
    rng = np.random.default_rng(seed)
    x, beta = rng.uniform(-0.7, 0.7, (30, 2)), parameters(trend, rng)
    found, reached = inverse(trend, beta, trend.value(beta, x), x + 0.02 * rng.normal(size=x.shape))
    assert reached.all()
    np.testing.assert_allclose(found, x, atol=1e-10)


def test_an_inverse_that_does_not_exist_is_not_reached():
    """r (1 − r²) never exceeds 0.385."""
    beta = np.array([1.0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, -1.0])
    _, reached = inverse(Lens(1), beta, np.array([[0.3, 0.0], [0.6, 0.0]]), np.array([[0.3, 0.0], [0.5, 0.0]]))
    assert reached.tolist() == [True, False]


@pytest.mark.parametrize("trend", [Homography(), Polynomial(3)], ids=lambda t: t.name)
def test_a_start_is_the_truth_where_least_squares_gives_it(trend):
    rng = np.random.default_rng(1)
    x, beta = rng.uniform(-1, 1, (200, 2)), parameters(trend, rng)
    np.testing.assert_allclose(trend.start(x, trend.value(beta, x)), beta, atol=1e-6)


@pytest.mark.parametrize("trend", ALL, ids=lambda t: t.name)
def test_a_name_leads_back_to_the_trend(trend):
    assert trends_named(trend.name) == [trend]


WRONG = ["", "lense", "lens:0", "lens:x", "lens:10", "lens:²", "constant", "homography:2:3", "homography:3"]


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_name_is_refused_with_the_right_ones(name):
    with pytest.raises(InputError, match="lens"):
        trends_named(name)
