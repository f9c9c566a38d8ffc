"""Laplace evidence of the linearised joint solve, and the hyperparameters that maximise it.

With the poses eliminated, residual r − J δ and prior θ + δ ~ N(0, Λ⁻¹), everything follows from the unit-
noise normal equations (S, s, ‖r‖²), so a trial of hyperparameters costs one Cholesky factor of A = S/σ² + Λ:

    log p = −½ (‖r‖²/σ² + θᵀΛθ − bᵀA⁻¹b) − ½ log|A| + ½ log|Λ| − ½ Σ_k log|C_k/σ²| − N log 2πσ²,   b = s/σ² − Λθ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from pinholify.arrays import Bools, Floats
from pinholify.refinement.normal import NormalEquations
from pinholify.refinement.spectral import LogDensity

LOG_2PI = float(np.log(2.0 * np.pi))
STD_RANGE = (1e-7, 0.1)  # of the process, in normalised image units; what is more is the trend's
NOISE_RANGE = (1e-8, 0.1)
LONGEST = 1.0
NOISE_ROUNDS, NOISE_TOLERANCE = 3, 1e-4
LARGEST_LOG_PRECISION = 100.0  # of a weight that the process cannot have


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Unit-noise equations around ``theta`` (D,): ``matrix`` S, ``right`` s, ``misfit`` ‖r‖², the rest as
    there.

    ``frequencies`` (M, 2) are those of the process's weights, the first 2M of θ; ``precision`` (D − 2M,) is
    the prior's of the rest.
    """

    matrix: Floats
    right: Floats
    misfit: float
    log_det_poses: float
    rows: int
    boards: int
    theta: Floats
    frequencies: Floats
    precision: Floats

    def without(self, removed: Bools) -> Linearised:
        """The same with the unknowns where ``removed`` (D,) is true held at zero; weights in pairs."""
        keep, gone = ~removed, -self.theta[removed]
        m = len(self.frequencies)
        columns = self.matrix[:, removed] @ gone
        return Linearised(
            self.matrix[np.ix_(keep, keep)],
            self.right[keep] - columns[keep],
            self.misfit - float(2.0 * self.right[removed] @ gone - gone @ columns[removed]),
            self.log_det_poses,
            self.rows,
            self.boards,
            self.theta[keep],
            self.frequencies[keep[:m]],
            self.precision[keep[2 * m :]],
        )

    def without_process(self) -> Linearised:
        """The same with the process switched off."""
        return self.without(np.arange(len(self.theta)) < 2 * len(self.frequencies))


def linearised(
    equations: NormalEquations, boards: int, theta: Floats, frequencies: Floats, precision: Floats
) -> Linearised:
    """The undamped ``equations`` around ``theta``."""
    return Linearised(
        equations.matrix,
        equations.right,
        equations.misfit,
        equations.log_det_poses,
        equations.rows,
        boards,
        theta,
        frequencies,
        precision,
    )


def process_averaged(at: Linearised, density: LogDensity, hyperparameters: Hyperparameters) -> Linearised:
    """``at`` with the process's weights integrated out: the same evidence at the noise of ``hyperparameters``."""
    m, noise = 2 * len(at.frequencies), hyperparameters.noise
    precision = hyperparameters.precision(density, at.frequencies, at.precision)[:m]
    root = precision**-0.5 / noise
    scaled = at.matrix[:m, :m] * root * root[:, None]
    scaled[np.diag_indices(m)] += 1.0
    cholesky = np.linalg.cholesky(scaled)
    weights = at.theta[:m]
    right = at.right + at.matrix[:, :m] @ weights  # as if linearised where they are zero
    misfit = at.misfit + float((at.right[:m] + right[:m]) @ weights)
    sides = solve_triangular(cholesky, root[:, None] * np.column_stack([at.matrix[:m, m:], right[:m]]), lower=True)
    cross, pull = sides[:, :-1], sides[:, -1]
    return Linearised(
        at.matrix[m:, m:] - cross.T @ cross,
        right[m:] - cross.T @ pull,
        misfit - float(pull @ pull),
        at.log_det_poses + 2.0 * float(np.log(np.diag(cholesky)).sum()),
        at.rows,
        at.boards,
        at.theta[m:],
        at.frequencies[:0],
        at.precision,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """At given hyperparameters: ``log_evidence``, the best step ``delta`` (D,), and what gradients need.

    ``shrinkage`` (D,) is the posterior variance of each unknown ÷ its prior variance, ``misfit`` the sum of
    squares left.
    """

    log_evidence: float
    delta: Floats
    shrinkage: Floats
    misfit: float


def posterior(at: Linearised, precision: Floats, noise: float) -> Posterior:
    """The Gaussian posterior for prior ``precision`` (D,) and ``noise`` per axis.

    Raises numpy.linalg.LinAlgError where double precision does not suffice.
    """
    root = precision**-0.5
    scaled = at.matrix * (root / noise)
    scaled *= (root / noise)[:, None]
    scaled[np.diag_indices(len(root))] += 1.0
    cholesky = np.linalg.cholesky(scaled)
    # The new unknowns, not the step to them: a prior that holds weights at zero would multiply the step's rounding.
    solved = cho_solve((cholesky, True), (at.right + at.matrix @ at.theta) * root / noise**2, check_finite=False)
    delta = solved * root - at.theta
    misfit = at.misfit - 2.0 * float(at.right @ delta) + float(delta @ at.matrix @ delta)
    quadratic = misfit / noise**2 + float(solved @ solved)
    log_det = 2.0 * float(np.log(np.diag(cholesky)).sum())
    log_noise = 2.0 * np.log(noise)
    poses = at.log_det_poses - 6.0 * at.boards * log_noise
    value = -0.5 * (quadratic + log_det + poses + at.rows * (LOG_2PI + log_noise))
    return Posterior(float(value), delta, np.diag(dpotri(cholesky, lower=1)[0]).copy(), misfit)


@dataclass(frozen=True, slots=True, eq=False)
class Hyperparameters:
    """``kernel`` log parameters (σ_f, length scales; normalised image units), empty where the process is off,
    and ``noise``.
    """

    kernel: Floats
    noise: float

    def precision(self, density: LogDensity, frequencies: Floats, rest: Floats) -> Floats:
        """Prior precision (D,) of all globals; ``rest`` is that of (β, η)."""
        if not len(frequencies):
            return rest
        weights = np.exp(np.minimum(-density(self.kernel, frequencies)[0], LARGEST_LOG_PRECISION))
        return np.concatenate([weights, weights, rest])


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Hyperparameters of the highest evidence found, and that evidence (with the length scale's prior)."""

    hyperparameters: Hyperparameters
    log_evidence: float


def profile_noise(at: Linearised, noise: float) -> Fit:
    """The noise of highest evidence where there is no process, by its fixed point from ``noise``."""
    for _ in range(NOISE_ROUNDS):
        found, before = posterior(at, at.precision, noise), noise
        freedom = at.rows - 6 * at.boards - (1.0 - found.shrinkage).sum()
        noise = max(float(np.sqrt(found.misfit / max(freedom, 1.0))), NOISE_RANGE[0])
        if abs(noise - before) < NOISE_TOLERANCE * noise:
            break
    return Fit(Hyperparameters(np.empty(0), noise), posterior(at, at.precision, noise).log_evidence)


def maximise_evidence(
    at: Linearised,
    density: LogDensity,
    start: Hyperparameters,
    *,
    shortest: float,
    resolved: float,
    most: int = 40,
) -> Fit:
    """Hyperparameters by L-BFGS with analytic gradients from ``start``.

    ``shortest`` is the penalised-complexity prior exp(−shortest/l); ``resolved`` the shortest length scale
    that the functions of ``at`` can carry.
    """
    # The evidence is far steeper in the noise than in the rest: in units of the noise's own uncertainty it is not.
    units = np.append(np.ones(len(start.kernel)), np.sqrt(1.0 / at.rows))
    low, high = _log_bounds(len(start.kernel) - 1, resolved) / units

    def loss(scaled: Floats) -> tuple[float, Floats]:
        parameters = scaled * units
        trial = Hyperparameters(parameters[:-1], float(np.exp(parameters[-1])))
        try:
            value, gradient = _negative_log_evidence(at, density, trial, shortest)
        except np.linalg.LinAlgError:  # no longer positive definite in double precision: not a place to be
            return 1e25, np.zeros(len(parameters))
        return value, gradient * units

    first = np.clip(np.append(start.kernel, np.log(start.noise)) / units, low, high)
    found = minimize(
        loss,
        first,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        options={"maxiter": most, "ftol": 1e-7, "gtol": 1e-2},
    )
    parameters = found.x * units
    return Fit(Hyperparameters(parameters[:-1], float(np.exp(parameters[-1]))), -float(found.fun))


def _log_bounds(scales: int, resolved: float) -> Floats:
    """Bounds (2, p) of the log parameters of a kernel of ``scales`` length scales, and of the log noise."""
    length = (resolved, max(LONGEST, resolved))
    kernel = [STD_RANGE, *[length] * scales] if scales > 0 else []
    return np.asarray(np.log([*kernel, NOISE_RANGE]).T)


def _negative_log_evidence(
    at: Linearised, density: LogDensity, trial: Hyperparameters, shortest: float
) -> tuple[float, Floats]:
    precision = trial.precision(density, at.frequencies, at.precision)
    found = posterior(at, precision, trial.noise)
    by_log_noise = found.misfit / trial.noise**2 + (1.0 - found.shrinkage).sum() - at.rows + 6 * at.boards
    if not len(trial.kernel):
        return -found.log_evidence, np.array([-by_log_noise])
    m = len(at.frequencies)
    by_log_precision = 0.5 * (1.0 - found.shrinkage - precision * (at.theta + found.delta) ** 2)
    by_log_density = -(by_log_precision[:m] + by_log_precision[m : 2 * m])
    gradient = by_log_density @ density(trial.kernel, at.frequencies)[1]
    scales = np.exp(trial.kernel[1:])
    gradient[1:] += shortest / scales
    value = found.log_evidence - shortest * float((1.0 / scales).sum())
    return -value, -np.append(gradient, by_log_noise)
