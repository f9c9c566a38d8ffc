"""Exact Gaussian-process regression (paper equations E and V; Rasmussen & Williams, chapter 2 and section 2.7).

Several outputs may share one kernel and one noise. The model may have a linear part with a Gaussian prior,
y = g(x) + F(x) c + noise; its coefficients c are shared by the outputs and integrated out, so that the likelihood and
the variance account for their uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dpotri

from pinholify.arrays import Floats
from pinholify.gp.kernels import Kernel

LOG_2PI = float(np.log(2.0 * np.pi))
MAX_KERNEL_VALUES = 16_384  # computed at once: as many stay in the processor's cache


@dataclass(frozen=True, slots=True, eq=False)
class LinearPart:
    """Features F (m, n, p) of m outputs at n points, and the prior c ~ N(mean, diag(std²)) of p coefficients."""

    features: Floats
    mean: Floats
    std: Floats


def no_linear_part(outputs: int, points: int) -> LinearPart:
    """A linear part without coefficients: plain GP regression."""
    return LinearPart(np.empty((outputs, points, 0)), np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True, eq=False)
class GaussianProcess:
    """A GP conditioned on data, with C = K + σ² diag(r²).

    ``inputs`` (n, d) are those of the data, ``weights`` (m, n) = C⁻¹(y − F c), ``cholesky`` (n, n) is the lower factor
    of C. ``coefficients`` (p,) is the posterior mean of the linear part, ``precision_factor`` (p, p) the lower Cholesky
    factor of its posterior precision, ``solved_features`` (m, n, p) = C⁻¹ F. ``relative_noise`` (n,) is r.
    """

    kernel: Kernel
    noise_std: float
    inputs: Floats
    weights: Floats
    cholesky: Floats
    coefficients: Floats
    precision_factor: Floats
    solved_features: Floats
    relative_noise: Floats
    log_marginal_likelihood: float

    def mean(self, x: Floats) -> Floats:
        """Posterior mean of g at ``x`` (q, d), without the linear part: (q, m)."""
        return self.mean_and_jacobian(x)[0]

    def jacobian(self, x: Floats) -> Floats:
        """∂ mean/∂x at ``x`` (q, d): (q, m, d)."""
        return self.mean_and_jacobian(x)[1]

    def mean_and_jacobian(self, x: Floats) -> tuple[Floats, Floats]:
        """:meth:`mean` and :meth:`jacobian` together, for little more time than one of them takes."""
        parts = np.array_split(x, len(x) * len(self.inputs) // MAX_KERNEL_VALUES + 1)
        means, jacobians = zip(*map(self._mean_and_jacobian, parts), strict=True)
        return np.concatenate(means), np.concatenate(jacobians)

    def _mean_and_jacobian(self, x: Floats) -> tuple[Floats, Floats]:
        """Both at so few ``x`` that the kernel's matrix stays in the processor's cache."""
        covariance, slope = self.kernel.covariance_and_slope(x, self.inputs)
        # Σ w D (x − x') over the training points x' by two products, without their differences from each x
        moments = slope @ (self.weights * self.inputs.T[:, None]).reshape(-1, len(self.inputs)).T
        pull = (slope @ self.weights.T)[:, :, None] * x[:, None, :]
        jacobian = pull - moments.reshape(*x.shape, len(self.weights)).transpose(0, 2, 1)
        return covariance @ self.weights.T, jacobian / self.kernel.length_scale**2

    def variance(self, x: Floats) -> Floats:
        """Posterior variance of g at ``x`` (q, d), the linear part taken as known, the same for each output: (q,)."""
        half = solve_triangular(self.cholesky, self.kernel.covariance(self.inputs, x), lower=True, check_finite=False)
        return np.asarray(np.maximum(self.kernel.std**2 - (half**2).sum(axis=0), 0.0))

    def covariance(self, x: Floats, features: Floats) -> Floats:
        """Posterior covariance of g + F c between the outputs at each of ``x`` (q, d): (q, m, m).

        ``features`` (m, q, p) are the linear part's at ``x``.
        """
        cross = self.kernel.covariance(x, self.inputs)
        unexplained = features - cross @ self.solved_features
        if not features.shape[2]:
            return np.asarray(self.variance(x)[:, None, None] * np.eye(len(self.weights)))
        sides = unexplained.reshape(-1, features.shape[2]).T  # nan where a place is
        half = solve_triangular(self.precision_factor, sides, lower=True, check_finite=False)
        half = half.reshape(features.shape[2], len(self.weights), len(x))
        linear = np.einsum("paq,pbq->qab", half, half)
        return np.asarray(linear + self.variance(x)[:, None, None] * np.eye(len(self.weights)))

    def with_coefficients_zero(self, observed: Data) -> GaussianProcess:
        """The same process with c = 0: g alone accounts for the targets of ``observed``."""
        weights = cho_solve((self.cholesky, True), observed.y).T
        return replace(self, weights=weights, coefficients=np.zeros_like(self.coefficients))

    def noise_response(self, x: Floats, features: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Changes of the mean of g + F c at ``x`` (q, d) for new draws of the targets' noise: (draws, q, m)."""
        m, n, p = self.solved_features.shape
        noise = self.noise_std * self.relative_noise * rng.standard_normal((draws, m, n))
        moved_weights = cho_solve((self.cholesky, True), noise.reshape(-1, n).T).T.reshape(draws, m, n)
        moved = np.zeros((draws, p))
        if p:
            right = np.einsum("mnp,dmn->pd", self.solved_features, noise)
            moved = cho_solve((self.precision_factor, True), right).T
            moved_weights = moved_weights - np.einsum("mnp,dp->dmn", self.solved_features, moved)
        cross = self.kernel.covariance(x, self.inputs)
        return np.asarray(
            np.einsum("qn,dmn->dqm", cross, moved_weights, optimize=True)
            + np.einsum("mqp,dp->dqm", features, moved, optimize=True)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """Targets ``y`` (n, m) at inputs ``x`` (n, d), the linear part, and the noise of each point.

    The noise of point i has the standard deviation σ · r[i], where ``relative_noise`` (n,) is r.
    """

    x: Floats
    y: Floats
    linear: LinearPart
    relative_noise: Floats


def data(x: Floats, y: Floats, linear: LinearPart | None = None, relative_noise: Floats | None = None) -> Data:
    """:class:`Data`, by default without a linear part and with equal noise."""
    n, m = y.shape
    return Data(
        x,
        y,
        no_linear_part(m, n) if linear is None else linear,
        np.ones(n) if relative_noise is None else relative_noise,
    )


def condition(kernel: Kernel, noise_std: float, observed: Data) -> GaussianProcess:
    """The GP with the given hyperparameters conditioned on ``observed``."""
    return _solve(kernel, noise_std, observed, kernel.covariance(observed.x, observed.x))


def _solve(kernel: Kernel, noise_std: float, observed: Data, covariance: Floats) -> GaussianProcess:
    x, y, linear = observed.x, observed.y, observed.linear
    n, m = y.shape
    noisy = covariance.copy()
    noisy[np.diag_indices(n)] += (noise_std * observed.relative_noise) ** 2
    cholesky: Floats = np.asarray(np.linalg.cholesky(noisy), dtype=np.float64)
    solved_targets = cho_solve((cholesky, True), y, check_finite=False).T
    solved_features = np.stack([cho_solve((cholesky, True), f, check_finite=False) for f in linear.features])
    precision = np.diag(linear.std**-2.0) + np.einsum("mnp,mnq->pq", linear.features, solved_features)
    right = linear.mean * linear.std**-2.0 + np.einsum("mnp,mn->p", linear.features, solved_targets)
    precision_factor: Floats = np.asarray(np.linalg.cholesky(precision), dtype=np.float64)
    coefficients = cho_solve((precision_factor, True), right)
    residual = y.T - linear.features @ coefficients
    weights = solved_targets - solved_features @ coefficients
    misfit = float((residual * weights).sum() + (((coefficients - linear.mean) / linear.std) ** 2).sum())
    log_determinant = 2.0 * (
        m * np.log(np.diag(cholesky)).sum() + np.log(np.diag(precision_factor)).sum() + np.log(linear.std).sum()
    )
    likelihood = -0.5 * (misfit + log_determinant + n * m * LOG_2PI)
    return GaussianProcess(
        kernel,
        noise_std,
        x,
        weights,
        cholesky,
        coefficients,
        precision_factor,
        solved_features,
        observed.relative_noise,
        float(likelihood),
    )


def likelihood_and_gradient(
    kernel: Kernel, noise_std: float, observed: Data, squared_differences: Floats
) -> tuple[float, Floats]:
    """Log marginal likelihood and its gradient by the kernel's log parameters and the log noise std (last).

    ``squared_differences`` are :meth:`Kernel.squared_differences` of the inputs with themselves, computed once per fit.
    """
    covariance, derivatives = kernel.covariance_and_gradients(squared_differences)
    gp = _solve(kernel, noise_std, observed, covariance)
    # Every dC is symmetric, so what lies below the diagonal of C⁻¹ counts twice and the upper part need not be filled.
    inverse = 2.0 * dpotri(gp.cholesky, lower=1)[0]
    inverse[np.diag_indices(len(inverse))] /= 2.0
    # dL = ½ Σ_ij dC_ij S_ij with S = Σ_outputs (w wᵀ + V Vᵀ) − m C⁻¹, V = C⁻¹F A^(−T/2)   (R&W 5.9, 2.45)
    sensitivity = gp.weights.T @ gp.weights - len(gp.weights) * inverse
    if len(gp.coefficients):
        for features in gp.solved_features:
            half = solve_triangular(gp.precision_factor, features.T, lower=True)
            sensitivity += half.T @ half
    gradient = [0.5 * np.vdot(d, sensitivity) for d in derivatives]
    gradient.append(noise_std**2 * float(np.diag(sensitivity) @ observed.relative_noise**2))
    return gp.log_marginal_likelihood, np.array(gradient)
