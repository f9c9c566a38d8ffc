"""The winning trend solved in full: the joint solve and its hyperparameters in turns, until neither changes.

Between turns the sines are chosen anew for the present length scale, and a warp and the motions are resized, if the
board has them. :func:`best_shape` chooses the board's shape beforehand, from the linearised problem.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Floats
from pinholify.errors import CalibrationError
from pinholify.refinement.basis import MAX_FREQUENCY, SineBasis, no_basis, sine_basis
from pinholify.refinement.candidates import EXTENSION_COST, SCREENING_LENGTH_SCALE, Candidate, Setting, solve_trend
from pinholify.refinement.evidence import Hyperparameters, ReducedProblem, maximise_evidence, posterior, reduced_problem
from pinholify.refinement.model import Model, State
from pinholify.refinement.motion import motion_of
from pinholify.refinement.normal import NormalEquations
from pinholify.refinement.observations import Observations
from pinholify.refinement.shape import WARP, BoardShape
from pinholify.refinement.solver import Loss, Solution, measured, minimise
from pinholify.refinement.spectral import LogDensity
from pinholify.refinement.warp import refitted

MAX_ROUNDS = 6
LOG_TOLERANCE = 0.02  # a round that changes every log hyperparameter by less is the last
SHAPE_SCORING_STEPS, SCORING_STEPS = 6, 15  # of the hyperparameters, for a shape and for a round
UNSEEN_NOISE_SHARE = 0.3  # of the noise: standard deviation that the functions may leave out of the process
LENGTH_SCALE_MARGIN = 0.9  # functions are chosen for length scales down to this part of the present one
FINEST_LENGTH_SCALE = 0.11  # half diagonals: the shortest that about 500 functions represent
MAX_STEPS = 20
MIN_GAIN = 0.02  # nats: a step that promises less is the last; it is taken, and what is left is far smaller


class SolveError(CalibrationError):
    """The full solve of a trend broke down; that of another one may not."""


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """The finished solve.

    ``equations`` are the undamped normal equations at ``solution``, ``problem`` the linearised problem there, and
    ``precision`` (D,) the prior's at the ``hyperparameters``.
    """

    model: Model
    solution: Solution
    equations: NormalEquations
    problem: ReducedProblem
    hyperparameters: Hyperparameters
    log_evidence: float
    precision: Floats

    @property
    def information(self) -> Floats:
        """The posterior precision (D, D) of the globals times the squared noise."""
        return self.equations.matrix + np.diag(self.precision * self.hyperparameters.noise**2)


def best_shape(setting: Setting, candidate: Candidate) -> tuple[BoardShape, Candidate]:
    """The family of shapes that the candidate's evidence prefers, and the candidate with its hyperparameters there.

    Each optional part of the shape has to be worth its cost, so the board is flat and square unless the data object.
    """
    problem, families = candidate.problem, setting.shape.smaller()
    if len(families) == 1:
        return families[0], candidate
    first = len(problem.theta) - len(setting.shape.prior_std)
    found = []
    for shape in families:
        removed = np.concatenate([np.zeros(first, dtype=bool), ~setting.shape.kept(shape)])
        fit = maximise_evidence(
            problem.without(removed),
            setting.density,
            candidate.hyperparameters,
            shortest=setting.shortest,
            resolved=FINEST_LENGTH_SCALE,
            most=SHAPE_SCORING_STEPS,
        )
        cost = EXTENSION_COST * shape.options
        found.append((fit.log_evidence - cost, shape, fit.hyperparameters))
    _, shape, hyperparameters = max(found, key=lambda each: each[0])
    return shape, replace(candidate, hyperparameters=hyperparameters)


def settle(
    setting: Setting, candidate: Candidate, seen: Observations, known: tuple[State, SineBasis] | None = None
) -> Settled:
    """The trend of ``candidate``, with its process and the shape of ``setting``, solved in full.

    The solve starts where the linearised problem leads, or from a ``known`` state and its functions where the same was
    solved for other corners. Raises SolveError where it breaks down.
    """
    hyperparameters, (state, before) = candidate.hyperparameters, known or _promised(setting, candidate, seen)
    resolved, shape, motion = _resolved(hyperparameters), setting.shape, setting.motion
    for _ in range(MAX_ROUNDS):
        basis = _basis(setting, hyperparameters, resolved)
        state, before = replace(state, weights=_carried(state.weights, before, basis)), basis
        settled = _solve(Model(candidate.trend, basis, shape, motion), setting.density, state, seen, hyperparameters)
        settled = _rewarped(settled, setting.density)
        fit = maximise_evidence(
            settled.problem,
            setting.density,
            hyperparameters,
            shortest=setting.shortest,
            resolved=resolved,
            most=SCORING_STEPS,
        )
        present = np.append(_logarithms(hyperparameters), np.log(shape.prior_std))
        hyperparameters, state, shape = fit.hyperparameters, settled.solution.state, settled.model.shape
        if motion:
            motion = motion_of(settled.solution, seen) or motion
        moved = np.abs(np.append(_logarithms(hyperparameters), np.log(shape.prior_std)) - present).max()
        finest = _finest_detail(hyperparameters)
        crowded = resolved > FINEST_LENGTH_SCALE and LENGTH_SCALE_MARGIN**0.5 * finest < resolved
        if moved < LOG_TOLERANCE and not crowded:
            break
        if crowded or finest > 2.0 * resolved / LENGTH_SCALE_MARGIN:
            resolved = _resolved(hyperparameters)
    frequencies = settled.model.basis.frequencies
    precision = hyperparameters.precision(setting.density, frequencies, settled.problem.precision)
    return replace(settled, hyperparameters=hyperparameters, log_evidence=fit.log_evidence, precision=precision)


def _promised(setting: Setting, candidate: Candidate, seen: Observations) -> tuple[State, SineBasis]:
    """The state that ``candidate``'s linearised problem predicts, with its poses unchanged, and its functions.

    Where the trend does not see all corners from there, a new solve without process stands in.
    """
    problem, origin, best = candidate.problem, candidate.origin, candidate.hyperparameters
    kept = origin.model.shape.kept(setting.shape)
    problem = problem.without(np.append(np.zeros(len(problem.theta) - len(kept), dtype=bool), ~kept))
    precision = best.precision(setting.density, problem.frequencies, problem.precision)
    theta = problem.theta + posterior(problem, precision, best.noise).delta
    weights, beta, eta = np.split(theta, np.cumsum([2 * len(problem.frequencies), len(candidate.trend.prior_std)]))
    basis = _basis(setting, best, SCREENING_LENGTH_SCALE)
    poses = origin.state.rotations, origin.state.translations, origin.state.motions
    state = State(weights.reshape(2, -1).T, beta, eta, *poses)
    if setting.model(candidate.trend, basis).predict(state, seen).valid:
        return state, basis
    plain = _found(solve_trend(setting, candidate.trend, origin, seen), setting.model(candidate.trend))
    return plain.state, no_basis(setting.half_size)


def _carried(weights: Floats, of: SineBasis, to: SineBasis) -> Floats:
    """``weights`` of the functions ``of`` transferred to the functions ``to``, (M, 2); new functions have zero."""
    return np.asarray((to.order[:, None] == of.order).all(axis=2) @ weights)


def _solve(
    model: Model, density: LogDensity, state: State, seen: Observations, hyperparameters: Hyperparameters
) -> Settled:
    """The solve of all unknowns at fixed hyperparameters, by Newton steps; by damped ones where these do not help."""
    noise = hyperparameters.noise
    precision = hyperparameters.precision(density, model.basis.frequencies, model.trend_precision())
    loss = Loss(noise)
    here, damped = _found(measured(model, state, seen, precision, loss), model), False
    for _ in range(MAX_STEPS):
        problem, equations = reduced_problem(model, here.state, seen, here.prediction)
        step = posterior(problem, precision, noise).delta
        promised = 0.5 * float(equations.right @ step + (equations.pose_right**2).sum()) / noise**2
        promised -= 0.5 * float(precision * problem.theta @ step)
        there = measured(model, here.state.moved(step, equations.pose_steps(step)), seen, precision, loss)
        if there is not None and there.objective <= here.objective:
            here = there
        elif not damped and promised >= MIN_GAIN:
            here, damped = _found(minimise(model, here.state, seen, precision, loss, most_steps=MAX_STEPS), model), True
            continue
        if damped or promised < MIN_GAIN:
            break
    return Settled(model, here, equations, problem, hyperparameters, -np.inf, precision)


def _rewarped(settled: Settled, density: LogDensity) -> Settled:
    """``settled`` with the board's warp, if it has one, resized by the evidence there."""
    if not settled.model.shape.has(WARP):
        return settled
    warp = refitted(settled.model.shape, settled.problem, density, settled.hyperparameters)
    model = replace(settled.model, shape=warp.shape)
    return replace(settled, model=model, problem=replace(settled.problem, precision=model.trend_precision()))


def _found(solution: Solution | None, model: Model) -> Solution:
    """``solution``; raises SolveError where there is none."""
    if solution is None:
        raise SolveError(f"the joint solve with trend {model.trend.name} broke down")
    return solution


def _resolved(hyperparameters: Hyperparameters) -> float:
    """The length scale that the functions have to resolve."""
    return max(FINEST_LENGTH_SCALE, LENGTH_SCALE_MARGIN * _finest_detail(hyperparameters))


def _finest_detail(hyperparameters: Hyperparameters) -> float:
    """The length scale whose functions omit less of the process than shows in the noise; infinite without a process.

    An SE process of length scale l has the share exp(−(ωl)²/2) of its variance beyond the frequency ω.
    """
    if not len(hyperparameters.kernel):
        return np.inf
    shown = np.exp(hyperparameters.kernel[0]) / (UNSEEN_NOISE_SHARE * hyperparameters.noise)
    needed = 2.0 * np.sqrt(np.log(max(shown, 1.0)))
    return float(np.exp(hyperparameters.kernel[1:].min()) * MAX_FREQUENCY / max(needed, MAX_FREQUENCY))


def _basis(setting: Setting, hyperparameters: Hyperparameters, resolved: float) -> SineBasis:
    if not len(hyperparameters.kernel):
        return no_basis(setting.half_size)
    return sine_basis(setting.half_size, resolved)


def _logarithms(hyperparameters: Hyperparameters) -> Floats:
    return np.append(hyperparameters.kernel, np.log(hyperparameters.noise))
