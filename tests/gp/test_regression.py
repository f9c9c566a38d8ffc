"""Exact regression against scikit-learn, mpmath and itself."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern
from sklearn.gaussian_process.kernels import RationalQuadratic as SklearnRQ

from pinholify.gp.hyperparameters import SearchRange, Start, maximise_likelihood
from pinholify.gp.kernels import KERNELS, Matern32, Matern52, RationalQuadratic, SquaredExponential, kernel_named
from pinholify.gp.regression import LinearPart, condition, data, likelihood_and_gradient

SIGNAL = 1.3
SCALE = 0.7
PAIRS = {
    "se": (SquaredExponential(SIGNAL, np.array([SCALE])), RBF(SCALE)),
    "ard-se": (SquaredExponential(SIGNAL, np.array([SCALE, 1.1])), RBF([SCALE, 1.1])),
    "matern32": (Matern32(SIGNAL, np.array([SCALE])), Matern(SCALE, nu=1.5)),
    "matern52": (Matern52(SIGNAL, np.array([SCALE])), Matern(SCALE, nu=2.5)),
    "rq": (RationalQuadratic(SIGNAL, np.array([SCALE]), 0.9), SklearnRQ(SCALE, 0.9)),
}


def samples(count=60, noise=0.13, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (count, 2))
    y = np.sin(2 * x[:, 0]) * np.cos(x[:, 1])
    return x, y + noise * rng.normal(size=count)


@pytest.mark.parametrize("name", PAIRS)
def test_likelihood_mean_and_variance_are_scikit_learns(name):
    ours, theirs = PAIRS[name]
    x, y = samples()
    noise = 0.13
    gp = condition(ours, noise, data(x, y[:, None]))
    oracle = GaussianProcessRegressor(ConstantKernel(SIGNAL**2) * theirs, alpha=noise**2, optimizer=None).fit(x, y)
    at = np.random.default_rng(1).uniform(-1.5, 1.5, (40, 2))
    mean, std = oracle.predict(at, return_std=True)
    assert gp.log_marginal_likelihood == pytest.approx(oracle.log_marginal_likelihood_value_, rel=1e-8)
    np.testing.assert_allclose(gp.mean(at)[:, 0], mean, rtol=1e-8, atol=1e-8 * np.abs(mean).max())
    np.testing.assert_allclose(gp.variance(at), std**2, rtol=1e-8)


def test_noise_of_a_ten_thousandth_of_the_signal_agrees_with_fifty_digits():
    noise = 1e-4
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 4)), -1).reshape(-1, 2)
    y = np.sin(grid[:, 0]) + grid[:, 1] ** 2
    gp = condition(SquaredExponential(1.0, np.array([1.0])), noise, data(grid, y[:, None]))
    at = np.array([[0.13, -0.4], [0.9, 0.7]])
    with mpmath.workdps(50):
        k = mpmath.matrix([[mpmath.exp(-mpmath.mpf(float(((p - q) ** 2).sum())) / 2) for q in grid] for p in grid])
        noisy = k + mpmath.mpf(noise) ** 2 * mpmath.eye(len(grid))
        target = mpmath.matrix([mpmath.mpf(float(v)) for v in y])
        solved = mpmath.lu_solve(noisy, target)
        likelihood = -(target.T * solved)[0] / 2 - mpmath.log(mpmath.det(noisy)) / 2
        likelihood -= len(grid) * mpmath.log(2 * mpmath.pi) / 2
        cross = [mpmath.matrix([mpmath.exp(-mpmath.mpf(float(((p - q) ** 2).sum())) / 2) for q in grid]) for p in at]
        means = [float((c.T * solved)[0]) for c in cross]
        variances = [float(1 - (c.T * mpmath.lu_solve(noisy, c))[0]) for c in cross]
    assert gp.log_marginal_likelihood == pytest.approx(float(likelihood), rel=1e-4)
    np.testing.assert_allclose(gp.mean(at)[:, 0], means, rtol=1e-4)
    np.testing.assert_allclose(gp.variance(at), variances, rtol=1e-4)


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("features", [0, 3])
def test_gradients_are_those_of_central_differences(name, features):
    x, y = samples(30)
    targets = np.stack([y, y**2], axis=1)
    linear = None
    if features:
        basis = np.stack([np.column_stack([np.ones(30), x]), np.column_stack([x, np.ones(30)])])
        linear = LinearPart(basis, np.array([0.1, 0.0, -0.2]), np.array([2.0, 1.0, 0.5]))
    observed = data(x, targets, linear, np.linspace(0.7, 1.6, 30))
    kernel = kernel_named(name)
    differences = kernel.squared_differences(x, x)

    def likelihood(p):
        return likelihood_and_gradient(kernel.with_log_parameters(p[:-1]), float(np.exp(p[-1])), observed, differences)

    at = np.append(kernel.log_parameters, -2.0) + 0.1 * np.arange(len(kernel.log_parameters) + 1)
    numeric = [(likelihood(at + e)[0] - likelihood(at - e)[0]) / 2e-5 for e in np.eye(len(at)) * 1e-5]
    np.testing.assert_allclose(likelihood(at)[1], numeric, rtol=1e-5)


@pytest.mark.parametrize("name", KERNELS)
def test_the_jacobian_of_the_mean_is_that_of_central_differences(name):
    x, y = samples(25)
    gp = condition(kernel_named(name), 0.2, data(x, np.stack([y, y**2], axis=1)))
    at = np.random.default_rng(2).uniform(-1, 1, (10, 2))
    numeric = np.stack([(gp.mean(at + e) - gp.mean(at - e)) / 2e-6 for e in np.eye(2) * 1e-6], axis=-1)
    np.testing.assert_allclose(gp.jacobian(at), numeric, atol=1e-7)


def test_many_points_at_once_are_as_one_by_one():
    x, y = samples(60)
    gp = condition(SquaredExponential(1.0, np.array([0.4, 0.6])), 0.2, data(x, np.stack([y, y**2], axis=1)))
    at = np.random.default_rng(3).uniform(-1, 1, (1_000, 2))
    mean, jacobian = gp.mean_and_jacobian(at)
    np.testing.assert_allclose(mean, gp.kernel.covariance(at, x) @ gp.weights.T, atol=1e-12)
    np.testing.assert_allclose(jacobian[::100], np.concatenate([gp.jacobian(p[None]) for p in at[::100]]), atol=1e-12)
    assert gp.mean(at[:0]).shape == (0, 2)


def test_a_linear_part_is_a_kernel_of_its_features():
    """y = g + F c + noise with c ~ N(0, S) has the covariance K + F S Fᵀ + σ² I (Rasmussen & Williams, 2.40)."""
    x, y = samples(40)
    basis, std = np.column_stack([np.ones(40), x]), np.array([2.0, 1.0, 0.5])
    gp = condition(SquaredExponential(), 0.2, data(x, y[:, None], LinearPart(basis[None], np.zeros(3), std)))
    full = SquaredExponential().covariance(x, x) + basis @ np.diag(std**2) @ basis.T + 0.04 * np.eye(40)
    _, logdet = np.linalg.slogdet(full)
    expected = -0.5 * (y @ np.linalg.solve(full, y) + logdet + 40 * np.log(2 * np.pi))
    assert gp.log_marginal_likelihood == pytest.approx(expected, rel=1e-10)
    at = np.array([[0.2, 0.3], [2.0, -1.0]])
    features = np.column_stack([np.ones(2), at])
    cross = SquaredExponential().covariance(at, x) + features @ np.diag(std**2) @ basis.T
    prior = SquaredExponential().covariance(at, at) + features @ np.diag(std**2) @ features.T
    mean = gp.mean(at)[:, 0] + features @ gp.coefficients
    np.testing.assert_allclose(mean, cross @ np.linalg.solve(full, y), rtol=1e-9)
    variance = np.diag(prior - cross @ np.linalg.solve(full, cross.T))
    np.testing.assert_allclose(gp.covariance(at, features[None])[:, 0, 0], variance, rtol=1e-8)


def test_noise_response_has_the_covariance_of_refitted_means():
    x, y = samples(40)
    linear = LinearPart(np.column_stack([np.ones(40), x])[None], np.zeros(3), np.full(3, 5.0))
    gp = condition(SquaredExponential(), 0.3, data(x, y[:, None], linear))
    at = np.array([[0.1, 0.2], [0.7, -0.6]])
    features = np.column_stack([np.ones(2), at])[None]
    rng = np.random.default_rng(3)
    refitted = []
    for _ in range(400):
        drawn = condition(SquaredExponential(), 0.3, data(x, (y + 0.3 * rng.normal(size=40))[:, None], linear))
        refitted.append(drawn.mean(at)[:, 0] + features[0] @ drawn.coefficients)
    response = gp.noise_response(at, features, 4000, np.random.default_rng(4))[:, :, 0]
    np.testing.assert_allclose(response.std(axis=0), np.std(refitted, axis=0), rtol=0.1)


def test_the_search_finds_what_scikit_learn_finds():
    x, y = samples(60)
    ours = maximise_likelihood(
        SquaredExponential(), data(x, y[:, None]), starts=[Start(1, length, 0.1) for length in (0.3, 1.0, 3.0)]
    )
    kernel = ConstantKernel(1.0, (1e-8, 1e8)) * RBF(1.0, (1e-2, 1e2))
    best = max(
        GaussianProcessRegressor(kernel, alpha=ours.noise_std**2, n_restarts_optimizer=3, random_state=seed)
        .fit(x, y)
        .log_marginal_likelihood_value_
        for seed in range(2)
    )
    assert ours.log_marginal_likelihood >= best - 1e-4
    assert ours.noise_std == pytest.approx(0.13, rel=0.3)


def test_a_prior_against_short_scales_keeps_the_gp_from_imitating_noise():
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 12), np.linspace(-1, 1, 8)), -1).reshape(-1, 2)
    starts = [Start(0.5, length, 0.5) for length in (0.1, 0.5)]
    search = SearchRange(std=(1e-5, 10.0), shortest=0.8)
    for _ in range(5):
        noise = rng.normal(size=(len(grid), 2))
        gp = maximise_likelihood(SquaredExponential(), data(grid, noise), starts=starts, search=search)
        assert gp.noise_std == pytest.approx(noise.std(), rel=0.1)


@given(st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_more_data_never_raises_the_variance(seed):
    x, y = samples(20, seed=seed)
    at = np.random.default_rng(seed + 1).uniform(-1, 1, (5, 2))
    fewer = condition(SquaredExponential(), 0.1, data(x[:10], y[:10, None]))
    more = condition(SquaredExponential(), 0.1, data(x, y[:, None]))
    assert (more.variance(at) <= fewer.variance(at) + 1e-9).all()
