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

from pinholify.arrays import Bools, Floats
from pinholify.refinement.normal import NormalEquations
from pinholify.refinement.spectral import LogDensity

LOG_2PI = float(np.log(2.0 * np.pi))
STD_RANGE = (1e-7, 0.1)  # of the process, in normalised image units; what is more is the trend's
NOISE_RANGE = (1e-8, 0.1)
LONGEST = 1.0
NOISE_ROUNDS, NOISE_TOLERANCE = 3, 1e-4
LARGEST_LOG_PRECISION = 100.0  # of a weight that the process cannot have
LONGEST_STEP = 2.0  # of any log hyperparameter in one step of the search
GAIN = 0.01  # nats that a step has to promise
HOPE = 5.0  # times what a step promises: what more is missing, no further steps will bring
RIDGE = 1e-6  # of the information, where the evidence tells nothing of a hyperparameter


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
    """At given hyperparameters: ``log_evidence``, the best step ``delta`` (D,), the sum of squares ``misfit`` that it
    leaves, and ``cholesky`` (D, D), the lower factor of the posterior precision in units of the prior's.
    """

    log_evidence: float
    delta: Floats
    misfit: float
    cholesky: Floats

    def covariance(self) -> Floats:
        """The posterior covariance in units of the prior's, (D, D): its lower triangle, zeros above."""
        return np.asarray(dpotri(self.cholesky.T, lower=0)[0].T)  # transposed, it is copied as it stands


def posterior(at: Linearised, precision: Floats, noise: float) -> Posterior:
    """The Gaussian posterior for prior ``precision`` (D,) and ``noise`` per axis.

    Raises numpy.linalg.LinAlgError where double precision does not suffice.
    """
    root = precision**-0.5
    scaled = at.matrix * (root / noise)
    scaled *= (root / noise)[:, None]
    scaled[np.diag_indices(len(root))] += 1.0
    cholesky: Floats = np.asarray(np.linalg.cholesky(scaled), dtype=np.float64)
    # The new unknowns, not the step to them: a prior that holds weights at zero would multiply the step's rounding.
    solved = cho_solve((cholesky, True), (at.right + at.matrix @ at.theta) * root / noise**2, check_finite=False)
    delta = solved * root - at.theta
    misfit = at.misfit - 2.0 * float(at.right @ delta) + float(delta @ at.matrix @ delta)
    quadratic = misfit / noise**2 + float(solved @ solved)
    log_det = 2.0 * float(np.log(np.diag(cholesky)).sum())
    return Posterior(-0.5 * (quadratic + log_det + float(_of_noise(at, noise))), delta, misfit, cholesky)


def _of_noise(at: Linearised, noise: float | Floats) -> float | Floats:
    """−2 times what the evidence owes to the poses' determinant and the number of residuals alone, elementwise."""
    log_noise = 2.0 * np.log(noise)
    return at.log_det_poses - 6.0 * at.boards * log_noise + at.rows * (LOG_2PI + log_noise)


@dataclass(frozen=True, slots=True, eq=False)
class Nested:
    """Posteriors of n models within one: ``noise`` (n,), ``log_evidence`` (n,), unknowns ``theta`` (n, D), zero where
    a model lacks them, the sums of squares ``misfit`` (n,) they leave, and how many the data ``determined`` (n,).
    """

    noise: Floats
    log_evidence: Floats
    theta: Floats
    misfit: Floats
    determined: Floats


def nested(at: Linearised, kept: Bools, noise: Floats) -> Nested:
    """The posteriors where only the unknowns ``kept`` (n, D) are free and the others zero, for ``noise`` (n,) each.

    ``at`` has no process: one call for many small models costs what a few calls of :func:`posterior` do.
    """
    root = kept * at.precision**-0.5
    scaled = at.matrix * (root[:, :, None] * root[:, None, :]) / noise[:, None, None] ** 2 + np.eye(root.shape[1])
    unit = np.diagonal(scaled, axis1=1, axis2=2) ** -0.5
    cholesky = np.linalg.cholesky(scaled * unit[:, :, None] * unit[:, None, :])
    inverse = np.linalg.inv(cholesky) * unit[:, None, :]
    right = (at.right + at.matrix @ at.theta) * root / noise[:, None] ** 2
    solved = (inverse.transpose(0, 2, 1) @ (inverse @ right[:, :, None]))[:, :, 0]
    theta = solved * root
    delta = theta - at.theta
    misfit = at.misfit - 2.0 * delta @ at.right + (delta @ at.matrix * delta).sum(axis=1)
    log_det = 2.0 * np.log(np.diagonal(cholesky, axis1=1, axis2=2) / unit).sum(axis=1)
    quadratic = misfit / noise**2 + (solved**2).sum(axis=1)
    log_evidence = -0.5 * (quadratic + log_det + _of_noise(at, noise))
    return Nested(noise, log_evidence, theta, misfit, (1.0 - (inverse**2).sum(axis=1)).sum(axis=1))


def nested_noise(at: Linearised, kept: Bools, noise: float) -> Nested:
    """:func:`nested` at the noise of highest evidence of each, by its fixed point from ``noise``."""
    found = nested(at, kept, np.full(len(kept), noise))
    for _ in range(NOISE_ROUNDS):
        freedom = np.maximum(at.rows - 6 * at.boards - found.determined, 1.0)
        better = np.maximum(np.sqrt(found.misfit / freedom), NOISE_RANGE[0])
        moved = np.abs(better / found.noise - 1.0).max()
        found = nested(at, kept, better)
        if moved < NOISE_TOLERANCE:
            break
    return found


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


def maximise_evidence(
    at: Linearised,
    density: LogDensity,
    start: Hyperparameters,
    *,
    shortest: float,
    resolved: float,
    most: int = 20,
    needed: float = -np.inf,
) -> Fit:
    """Hyperparameters by Fisher scoring from ``start``, in at most ``most`` steps.

    ``shortest`` is the penalised-complexity prior exp(−shortest/l); ``resolved`` the shortest length scale
    that the functions of ``at`` can carry; the search is left where the log evidence ``needed`` is out of reach. Raises
    numpy.linalg.LinAlgError where ``start`` has no evidence.
    """
    low, high = _log_bounds(len(start.kernel) - 1, resolved)
    here = _scored(at, density, np.clip(np.append(start.kernel, np.log(start.noise)), low, high), shortest)
    longest = LONGEST_STEP
    for _ in range(most):
        room = np.array([low, high]) - here.parameters
        step, promised = here.step(*np.clip(room, -longest, longest))
        if promised < max(GAIN, (needed - here.value) / HOPE):
            break
        try:
            there = _scored(at, density, here.parameters + step, shortest)
        except np.linalg.LinAlgError:  # no longer positive definite in double precision: not a place to be
            there = here
        if there.value > here.value:
            here, longest = there, min(2.0 * longest, LONGEST_STEP)
        else:
            longest = 0.25 * float(np.abs(step).max())
    return Fit(_hyperparameters(here.parameters), here.value)


def _log_bounds(scales: int, resolved: float) -> Floats:
    """Bounds (2, p) of the log parameters of a kernel of ``scales`` length scales, and of the log noise."""
    length = (resolved, max(LONGEST, resolved))
    kernel = [STD_RANGE, *[length] * scales] if scales > 0 else []
    return np.asarray(np.log([*kernel, NOISE_RANGE]).T)


def _hyperparameters(parameters: Floats) -> Hyperparameters:
    return Hyperparameters(parameters[:-1], float(np.exp(parameters[-1])))


@dataclass(frozen=True, slots=True, eq=False)
class _Scored:
    """The log evidence with the length scale's prior at ``parameters`` (p,), log kernel parameters and log noise: its
    ``value``, ``gradient`` (p,) and Fisher ``information`` (p, p).
    """

    parameters: Floats
    value: float
    gradient: Floats
    information: Floats

    def step(self, low: Floats, high: Floats) -> tuple[Floats, float]:
        """The scoring step (p,) between ``low`` and ``high`` (p,), and the gain that it promises.

        What would go too far is held at its limit, the farthest first, and the others go where that leads them.
        """
        step, free = np.zeros_like(self.gradient), np.ones(len(self.gradient), dtype=bool)
        matrix = self.information + np.diag(RIDGE * (1.0 + np.diag(self.information)))
        while free.any():
            held = matrix[np.ix_(free, ~free)] @ step[~free]
            step[free] = np.linalg.solve(matrix[np.ix_(free, free)], self.gradient[free] - held)
            limit = np.where(step > 0, high, low)
            excess = np.where(free, np.abs(step) / np.maximum(np.abs(limit), 1e-300), 0.0)
            if not excess.max() > 1.0:
                break
            farthest = int(excess.argmax())
            step[farthest], free[farthest] = limit[farthest], False
        return step, float(self.gradient @ step - 0.5 * step @ self.information @ step)


def _scored(at: Linearised, density: LogDensity, parameters: Floats, shortest: float) -> _Scored:
    """Value and derivatives in closed form."""
    trial, m = _hyperparameters(parameters), 2 * len(at.frequencies)
    precision = trial.precision(density, at.frequencies, at.precision)
    found = posterior(at, precision, trial.noise)
    covariance = found.covariance()
    shrinkage = np.diag(covariance).copy()
    freedom = at.rows - 6 * at.boards - len(precision)
    gradient = np.array([found.misfit / trial.noise**2 - shrinkage.sum() - freedom])
    if not m:
        slopes = np.empty((0, 0))
        return _Scored(parameters, found.log_evidence, gradient, _information(covariance, slopes, freedom))
    by_precision = 0.5 * (1.0 - shrinkage - precision * (at.theta + found.delta) ** 2)[:m]
    slopes = np.tile(density(trial.kernel, at.frequencies)[1], (2, 1))
    prior = np.append(0.0, shortest * np.exp(-trial.kernel[1:]))
    information = _information(covariance, slopes, freedom)
    information[np.diag_indices(len(prior))] += prior
    return _Scored(
        parameters, found.log_evidence - prior.sum(), np.append(prior - by_precision @ slopes, gradient), information
    )


def _information(covariance: Floats, slopes: Floats, freedom: float) -> Floats:
    """Fisher information (p, p) of the log kernel parameters, by which the log variances of the first m unknowns have
    ``slopes`` (m, p − 1), and of the log noise. ``covariance`` (D, D) is B⁻¹, the posterior's in units of the prior's,
    its lower triangle; ``freedom`` the residuals beyond the unknowns.

    With Q = 1 − B⁻¹ that of two log variances' derivatives d, e is ½ dᵀ(Q∘Q)e, that of d and the log noise
    dᵀ diag(B⁻¹ − B⁻²), that of the log noise twice the trace of the identity on the freedom and of B⁻².
    """
    m, own = len(slopes), np.diag(covariance).copy()
    lower = covariance**2
    squares = lower.sum(axis=0) + lower.sum(axis=1) - own**2  # the diagonal of B⁻²
    noise = np.array([[2.0 * (freedom + squares.sum())]])
    if not m:
        return noise
    process = lower[:m, :m]
    process[np.diag_indices(m)] = 0.5 * (1.0 - own[:m]) ** 2
    half = slopes.T @ process @ slopes
    shared = slopes.T @ (own - squares)[:m, None]
    return np.block([[0.5 * (half + half.T), shared], [shared.T, noise]])
