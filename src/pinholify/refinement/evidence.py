"""The Laplace evidence of the linearised joint solve, and the hyperparameters that maximise it.

With the poses eliminated, the residual is r − J δ and the prior θ + δ ~ N(0, Λ⁻¹). Everything then follows from the
normal equations at unit noise (S, s, ‖r‖²), so that each trial of hyperparameters costs one Cholesky factor of
A = S/σ² + Λ:

    log p = −½ (‖r‖²/σ² + θᵀΛθ − bᵀA⁻¹b) − ½ log|A| + ½ log|Λ| − ½ Σ_k log|C_k/σ²| − N log 2πσ²,   b = s/σ² − Λθ.

Hyperparameters are the kernel's and the noise σ. For a model with fewer unknowns than S has, rows and columns are left
out; that is how one solve ranks a whole family of trends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dpotri

from pinholify.arrays import Bools, Floats
from pinholify.geometry import POSE_DOF
from pinholify.gp.regression import LOG_2PI
from pinholify.refinement.model import Model, Prediction, State
from pinholify.refinement.normal import NormalEquations, eliminate
from pinholify.refinement.observations import Observations
from pinholify.refinement.spectral import LogDensity

STD_RANGE = (1e-7, 0.1)  # of the process, in normalised image units; larger displacements are for the trend
NOISE_RANGE = (1e-8, 0.1)  # normalised image units
MAX_LENGTH_SCALE = 1.0  # half diagonals of the image
NOISE_ROUNDS, NOISE_TOLERANCE = 3, 1e-4  # of the fixed point of the noise
MAX_LOG_PRECISION = 100.0  # of a weight: larger ones, for weights that are zero, would overflow
MAX_LOG_STEP = 2.0  # of any log hyperparameter in one step of the search
MIN_GAIN = 0.01  # nats: a step that promises less ends the search
MAX_GAIN_RATIO = 5.0  # of the gain of all further steps to what the next one promises
RIDGE = 1e-6  # relative, on the information, for hyperparameters that the evidence does not determine


@dataclass(frozen=True, slots=True, eq=False)
class ReducedProblem:
    """The problem linearised around ``theta`` (D,), with the poses eliminated, at unit noise.

    ``matrix`` S (D, D), ``right`` s (D,), ``misfit`` ‖r‖², ``log_det_poses`` and ``rows`` are those of
    :class:`NormalEquations`; ``boards`` is their number. ``frequencies`` (M, 2) are those of the process's weights, the
    first 2M of θ; ``precision`` (D − 2M,) is the prior's of the other unknowns.
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

    def without(self, removed: Bools) -> ReducedProblem:
        """The same problem with the unknowns where ``removed`` (D,) is True fixed at zero; weights only in pairs."""
        keep, gone = ~removed, -self.theta[removed]
        m = len(self.frequencies)
        columns = self.matrix[:, removed] @ gone
        return ReducedProblem(
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

    def without_process(self) -> ReducedProblem:
        """The same problem with the process switched off."""
        return self.without(np.arange(len(self.theta)) < 2 * len(self.frequencies))


def reduced_problem(
    model: Model, state: State, seen: Observations, at: Prediction
) -> tuple[ReducedProblem, NormalEquations]:
    """The problem linearised around ``state``, which predicts ``at``, and the equations, which give the pose steps."""
    equations = eliminate(model.linearise(state, seen, at), at.residual, seen.weight**2, seen)
    problem = ReducedProblem(
        equations.matrix,
        equations.right,
        equations.misfit,
        equations.log_det_poses,
        equations.rows,
        seen.boards,
        state.globals,
        model.basis.frequencies,
        model.trend_precision(),
    )
    return problem, equations


def process_averaged(at: ReducedProblem, density: LogDensity, hyperparameters: Hyperparameters) -> ReducedProblem:
    """``at`` with the process's weights integrated out: it has the same evidence, at the ``hyperparameters`` given."""
    m, noise = 2 * len(at.frequencies), hyperparameters.noise
    precision = hyperparameters.precision(density, at.frequencies, at.precision)[:m]
    root = precision**-0.5 / noise
    scaled = at.matrix[:m, :m] * root * root[:, None]
    scaled[np.diag_indices(m)] += 1.0
    cholesky = np.linalg.cholesky(scaled)
    weights = at.theta[:m]
    right = at.right + at.matrix[:, :m] @ weights  # as if linearised at zero weights
    misfit = at.misfit + float((at.right[:m] + right[:m]) @ weights)
    sides = solve_triangular(cholesky, root[:, None] * np.column_stack([at.matrix[:m, m:], right[:m]]), lower=True)
    cross, pull = sides[:, :-1], sides[:, -1]
    return ReducedProblem(
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
    """The Gaussian posterior at given hyperparameters.

    ``delta`` (D,) is the step to its mean, ``misfit`` the sum of squares there, and ``cholesky`` (D, D) the lower
    factor of the posterior precision in units of the prior's.
    """

    log_evidence: float
    delta: Floats
    misfit: float
    cholesky: Floats

    def covariance(self) -> Floats:
        """The posterior covariance in units of the prior's, (D, D): its lower triangle, zeros above."""
        return np.asarray(dpotri(self.cholesky.T, lower=0)[0].T)  # transposed, it is copied without reordering


def posterior(at: ReducedProblem, precision: Floats, noise: float) -> Posterior:
    """The Gaussian posterior for prior ``precision`` (D,) and ``noise`` per axis, normalised.

    Raises numpy.linalg.LinAlgError where the posterior precision is not positive definite in double precision.
    """
    root = precision**-0.5
    scaled = at.matrix * (root / noise)
    scaled *= (root / noise)[:, None]
    scaled[np.diag_indices(len(root))] += 1.0
    cholesky: Floats = np.asarray(np.linalg.cholesky(scaled), dtype=np.float64)
    # Solve for the new unknowns, not for the step: a prior that holds weights at zero would amplify its rounding.
    solved = cho_solve((cholesky, True), (at.right + at.matrix @ at.theta) * root / noise**2, check_finite=False)
    delta = solved * root - at.theta
    misfit = at.misfit - 2.0 * float(at.right @ delta) + float(delta @ at.matrix @ delta)
    quadratic = misfit / noise**2 + float(solved @ solved)
    log_det = 2.0 * float(np.log(np.diag(cholesky)).sum())
    return Posterior(-0.5 * (quadratic + log_det + float(_of_noise(at, noise))), delta, misfit, cholesky)


def _of_noise(at: ReducedProblem, noise: float | Floats) -> float | Floats:
    """−2 times the terms of the evidence by the poses' determinants and the number of residuals, elementwise."""
    log_noise = 2.0 * np.log(noise)
    return at.log_det_poses - POSE_DOF * at.boards * log_noise + at.rows * (LOG_2PI + log_noise)


@dataclass(frozen=True, slots=True, eq=False)
class Nested:
    """Posteriors of n models within a larger one, each with its ``noise`` (n,) and ``log_evidence`` (n,).

    ``theta`` (n, D) are their unknowns, zero where a model lacks them, ``misfit`` (n,) the sums of squares, and
    ``determined`` (n,) the effective number of unknowns that the data determine.
    """

    noise: Floats
    log_evidence: Floats
    theta: Floats
    misfit: Floats
    determined: Floats


def nested(at: ReducedProblem, kept: Bools, noise: Floats) -> Nested:
    """The posteriors of n models whose free unknowns are ``kept`` (n, D) and the others zero, for ``noise`` (n,).

    ``at`` has no process. One call for many small models costs as much as a few calls of :func:`posterior`.
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


def nested_noise(at: ReducedProblem, kept: Bools, noise: float) -> Nested:
    """:func:`nested` with the noise of highest evidence of each model, by fixed-point iteration from ``noise``."""
    found = nested(at, kept, np.full(len(kept), noise))
    for _ in range(NOISE_ROUNDS):
        freedom = np.maximum(at.rows - POSE_DOF * at.boards - found.determined, 1.0)
        with np.errstate(invalid="ignore"):  # a misfit below zero by rounding: that model gets no evidence
            better = np.maximum(np.sqrt(found.misfit / freedom), NOISE_RANGE[0])
        moved = np.abs(better / found.noise - 1.0).max()
        found = nested(at, kept, better)
        if moved < NOISE_TOLERANCE:
            break
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Hyperparameters:
    """``kernel`` holds the logs of σ_f and the length scales, empty where the process is off; ``noise`` is per axis.

    All are in normalised image units.
    """

    kernel: Floats
    noise: float

    def precision(self, density: LogDensity, frequencies: Floats, rest: Floats) -> Floats:
        """Prior precision (D,) of all globals; ``rest`` is that of all but the weights."""
        if not len(frequencies):
            return rest
        weights = np.exp(np.minimum(-density(self.kernel, frequencies)[0], MAX_LOG_PRECISION))
        return np.concatenate([weights, weights, rest])


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The hyperparameters of the highest evidence found, and that evidence, including the length scales' prior."""

    hyperparameters: Hyperparameters
    log_evidence: float


def maximise_evidence(
    at: ReducedProblem,
    density: LogDensity,
    start: Hyperparameters,
    *,
    shortest: float,
    resolved: float,
    most: int = 20,
    needed: float = -np.inf,
) -> Fit:
    """The hyperparameters of highest evidence, by at most ``most`` steps of Fisher scoring from ``start``.

    ``shortest`` is that of the penalised-complexity prior exp(−shortest/l) of the length scales; ``resolved`` is the
    shortest length scale that the functions of ``at`` can represent. The search stops early where the log evidence
    ``needed`` is out of reach. Raises numpy.linalg.LinAlgError where ``start`` has no evidence.
    """
    low, high = _log_bounds(len(start.kernel) - 1, resolved)
    here = _scored(at, density, np.clip(np.append(start.kernel, np.log(start.noise)), low, high), shortest)
    longest = MAX_LOG_STEP
    for _ in range(most):
        room = np.array([low, high]) - here.parameters
        step, promised = here.step(*np.clip(room, -longest, longest))
        if promised < max(MIN_GAIN, (needed - here.value) / MAX_GAIN_RATIO):
            break
        try:
            there = _scored(at, density, here.parameters + step, shortest)
        except np.linalg.LinAlgError:  # not positive definite in double precision: try a shorter step
            there = here
        if there.value > here.value:
            here, longest = there, min(2.0 * longest, MAX_LOG_STEP)
        else:
            longest = 0.25 * float(np.abs(step).max())
    return Fit(_hyperparameters(here.parameters), here.value)


def _log_bounds(scales: int, resolved: float) -> Floats:
    """Bounds (2, p) of the log parameters of a kernel of ``scales`` length scales, and of the log noise."""
    length = (resolved, max(MAX_LENGTH_SCALE, resolved))
    kernel = [STD_RANGE, *[length] * scales] if scales > 0 else []
    return np.asarray(np.log([*kernel, NOISE_RANGE]).T)


def _hyperparameters(parameters: Floats) -> Hyperparameters:
    return Hyperparameters(parameters[:-1], float(np.exp(parameters[-1])))


@dataclass(frozen=True, slots=True, eq=False)
class _Scored:
    """The log evidence, with the length scales' prior, at ``parameters`` (p,): log kernel parameters and log noise.

    It comes with its ``gradient`` (p,) and its Fisher ``information`` (p, p).
    """

    parameters: Floats
    value: float
    gradient: Floats
    information: Floats

    def step(self, low: Floats, high: Floats) -> tuple[Floats, float]:
        """The scoring step (p,) between ``low`` and ``high`` (p,), and the gain that it promises.

        Components that would exceed their limits are fixed there, the farthest first, and the others solved anew.
        """
        step, free = np.zeros_like(self.gradient), np.ones(len(self.gradient), dtype=bool)
        matrix = self.information + np.diag(RIDGE * (1.0 + np.diag(self.information)))
        while free.any():
            held = matrix[np.ix_(free, ~free)] @ step[~free]
            step[free] = np.linalg.solve(matrix[np.ix_(free, free)], self.gradient[free] - held)
            limit = np.where(step > 0, high, low)
            with np.errstate(over="ignore"):  # a limit of zero
                excess = np.where(free, np.abs(step) / np.maximum(np.abs(limit), 1e-300), 0.0)
            if not excess.max() > 1.0:
                break
            farthest = int(excess.argmax())
            step[farthest], free[farthest] = limit[farthest], False
        return step, float(self.gradient @ step - 0.5 * step @ self.information @ step)


def _scored(at: ReducedProblem, density: LogDensity, parameters: Floats, shortest: float) -> _Scored:
    """The log evidence and its derivatives at ``parameters`` (p,), in closed form."""
    trial, m = _hyperparameters(parameters), 2 * len(at.frequencies)
    precision = trial.precision(density, at.frequencies, at.precision)
    found = posterior(at, precision, trial.noise)
    covariance = found.covariance()
    shrinkage = np.diag(covariance).copy()
    freedom = at.rows - POSE_DOF * at.boards - len(precision)
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
    """Fisher information (p, p) of the log kernel parameters and the log noise.

    ``slopes`` (m, p − 1) are the derivatives of the log variances of the first m unknowns by the log kernel parameters,
    ``covariance`` (D, D) is the lower triangle of B⁻¹, the posterior's in units of the prior's, and ``freedom`` the
    number of residuals beyond the unknowns. With Q = 1 − B⁻¹ and derivatives d and e of the log variances, the
    information of d and e is ½ dᵀ(Q∘Q)e, that of d and the log noise dᵀ diag(B⁻¹ − B⁻²), and that of the log noise
    twice the sum of ``freedom`` and the trace of B⁻².
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
