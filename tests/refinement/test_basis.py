import numpy as np
import pytest

from pinholify.errors import InputError
from pinholify.gp.kernels import kernel_named
from pinholify.refinement.basis import no_basis, sine_basis
from pinholify.refinement.spectral import DENSITIES, density_named

HALF = np.array([0.8, 0.6])


@pytest.mark.parametrize(("name", "tolerance"), [("se", 5e-3), ("ard-se", 2e-2), ("matern52", 2e-2)])
def test_sines_weighted_by_the_density_have_the_kernels_covariance(name: str, tolerance: float) -> None:
    density, scales = density_named(name)
    parameters = np.log([1.7, *[0.25, 0.32][:scales]])
    basis = sine_basis(HALF, 0.1 if name == "matern52" else 0.2)
    x = 0.8 * np.random.default_rng(0).uniform(-1, 1, (40, 2)) * HALF  # the box's edge is felt near the image's
    phi = basis.values(x)
    carried = (phi * np.exp(density(parameters, basis.frequencies)[0])) @ phi.T
    kernel = kernel_named(name).with_log_parameters(parameters)
    np.testing.assert_allclose(carried, kernel.covariance(x, x), atol=tolerance * 1.7**2)


@pytest.mark.parametrize("name", DENSITIES)
def test_gradient_of_the_log_density(name: str) -> None:
    density, scales = density_named(name)
    parameters = np.log([1.3, *[0.3, 0.4][:scales]])
    frequencies = sine_basis(HALF, 0.3).frequencies
    gradient = density(parameters, frequencies)[1]
    for i, h in enumerate(1e-6 * np.eye(len(parameters))):
        numeric = (density(parameters + h, frequencies)[0] - density(parameters - h, frequencies)[0]) / 2e-6
        np.testing.assert_allclose(gradient[:, i], numeric, atol=1e-6)


def test_combination_and_its_slope() -> None:
    basis = sine_basis(HALF, 0.3)
    rng = np.random.default_rng(1)
    weights, w = rng.normal(size=(len(basis), 2)), rng.uniform(-1, 1, (20, 2)) * HALF
    value, slope = basis.combine(weights, w)
    np.testing.assert_allclose(value, basis.values(w) @ weights, atol=1e-12)
    np.testing.assert_allclose(basis.combined(weights, w), value, atol=1e-14)
    for axis, h in enumerate(1e-6 * np.eye(2)):
        numeric = (basis.combine(weights, w + h)[0] - basis.combine(weights, w - h)[0]) / 2e-6
        np.testing.assert_allclose(slope[:, :, axis], numeric, rtol=1e-6, atol=1e-6)


def test_undisplaced_undoes_the_displacement() -> None:
    basis = sine_basis(HALF, 0.4)
    rng = np.random.default_rng(2)
    weights, w = 2e-3 * rng.normal(size=(len(basis), 2)), rng.uniform(-1, 1, (50, 2)) * HALF
    np.testing.assert_allclose(basis.undisplaced(weights, w + basis.combine(weights, w)[0]), w, atol=1e-12)


def test_points_that_are_far_displaced_are_found_beside_one_that_does_not_exist() -> None:
    basis = sine_basis(HALF, 0.4)
    rng = np.random.default_rng(3)
    weights, w = 1e-2 * rng.normal(size=(len(basis), 2)), rng.uniform(-1, 1, (50, 2)) * HALF
    displaced, slope = basis.combine(weights, w)
    assert np.abs(slope).max() > 0.3
    x = w + displaced
    x[7] = w[7] = np.nan
    np.testing.assert_allclose(basis.undisplaced(weights, x), w, atol=1e-12)


def test_no_basis_is_no_displacement() -> None:
    w = np.ones((3, 2))
    value, slope = no_basis(HALF).combine(np.zeros((0, 2)), w)
    assert not value.any()
    assert not no_basis(HALF).combined(np.zeros((0, 2)), w).any()
    assert slope.shape == (3, 2, 2)
    assert not slope.any()


def test_unknown_kernel_is_named_with_those_there_are() -> None:
    with pytest.raises(InputError, match=r"rq.*se, ard-se"):
        density_named("rq")


def test_quadratic_forms_are_sums_of_cosines() -> None:
    rng = np.random.default_rng(4)
    basis = sine_basis(np.array([0.8, 0.6]), 0.3)
    matrices = rng.normal(size=(2, len(basis), len(basis)))
    w = rng.uniform(-1.0, 1.0, (40, 2))
    values = basis.values(w)
    expected = np.einsum("na,mab,nb->nm", values, matrices, values)
    np.testing.assert_allclose(basis.summed(basis.product_series(matrices), w), expected, atol=1e-11)


def test_gram_matrix_by_cosines() -> None:
    rng = np.random.default_rng(5)
    basis = sine_basis(np.array([0.8, 0.6]), 0.3)
    w, weight = rng.uniform(-1.0, 1.0, (200, 2)), rng.uniform(0.5, 2.0, 200)
    values = basis.values(w)
    np.testing.assert_allclose(basis.gram(w, weight), (values.T * weight) @ values, atol=1e-11)
    assert no_basis(HALF).gram(w, weight).shape == (0, 0)

