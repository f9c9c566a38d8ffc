"""The winner solved in full: the joint solve and its hyperparameters in turns, until neither moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Floats
from pinholify.errors import CalibrationError
from pinholify.refinement.basis import SineBasis, no_basis, sine_basis
from pinholify.refinement.candidates import WORTH, Candidate, Setting, solve_trend
from pinholify.refinement.evidence import Hyperparameters, Linearised, linearised, maximise_evidence
from pinholify.refinement.model import Model, State
from pinholify.refinement.normal import NormalEquations, eliminate
from pinholify.refinement.observations import Observations
from pinholify.refinement.shape import BoardShape
from pinholify.refinement.solver import Loss, Solution, minimise
from pinholify.refinement.spectral import LogDensity

ROUNDS = 6
SETTLED = 0.02  # change of any log hyperparameter
SAFETY = 0.9  # length scales down to this part of the present one are carried
FINEST = 0.11  # half diagonals: what 500 functions carry


class SolveError(CalibrationError):
    """A trend whose full solve breaks down; another may do."""


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """The finished solve: the model, its unknowns, the undamped equations there, hyperparameters and
    evidence.
    """

    model: Model
    solution: Solution
    equations: NormalEquations
    problem: Linearised
    hyperparameters: Hyperparameters
    log_evidence: float
    precision: Floats


def best_shape(setting: Setting, candidate: Candidate) -> tuple[BoardShape, Candidate]:
    """The shape of the board that the candidate's evidence prefers, flat and square unless another is worth it; and
    the candidate with the hyperparameters of that evidence.
    """
    problem = candidate.problem
    first = len(problem.theta) - len(setting.shape.prior_std)
    found = []
    for shape in setting.shape.smaller():
        removed = np.concatenate([np.zeros(first, dtype=bool), ~setting.shape.kept(shape)])
        fit = maximise_evidence(
            problem.without(removed),
            setting.density,
            candidate.hyperparameters,
            shortest=setting.shortest,
            resolved=FINEST,
            most=6,
        )
        cost = WORTH * (shape.bends + shape.stretches)
        found.append((fit.log_evidence - cost, shape, fit.hyperparameters))
    _, shape, hyperparameters = max(found, key=lambda each: each[0])
    return shape, replace(candidate, hyperparameters=hyperparameters)


def settle(setting: Setting, candidate: Candidate, seen: Observations, known: State | None = None) -> Settled:
    """``candidate``'s trend with ``setting``'s shape, solved with its process from its origin, or from
    ``known``, where the same was solved for other corners.

    Raises SolveError where the solve breaks down.
    """
    hyperparameters, state = candidate.hyperparameters, known or _without_process(setting, candidate, seen)
    resolved = _resolved(hyperparameters)
    for _ in range(ROUNDS):
        basis = _basis(setting, hyperparameters, resolved)
        if len(basis) != len(state.weights):
            state = replace(state, weights=np.zeros((len(basis), 2)))
        settled = _solve(setting.model(candidate.trend, basis), setting.density, state, seen, hyperparameters)
        fit = maximise_evidence(
            settled.problem,
            setting.density,
            hyperparameters,
            shortest=setting.shortest,
            resolved=resolved,
            most=15,
        )
        moved = np.abs(_logarithms(fit.hyperparameters) - _logarithms(hyperparameters)).max()
        hyperparameters, state = fit.hyperparameters, settled.solution.state
        crowded = resolved > FINEST and SAFETY**0.5 * _length_scale(hyperparameters) < resolved
        if moved < SETTLED and not crowded:
            break
        if crowded or _length_scale(hyperparameters) > 2.0 * resolved / SAFETY:
            resolved = _resolved(hyperparameters)
    frequencies = settled.model.basis.frequencies
    precision = hyperparameters.precision(setting.density, frequencies, settled.problem.precision)
    return replace(settled, hyperparameters=hyperparameters, log_evidence=fit.log_evidence, precision=precision)


def _without_process(setting: Setting, candidate: Candidate, seen: Observations) -> State:
    plain = solve_trend(setting, candidate.trend, candidate.origin, seen)
    if plain is None:
        raise SolveError(f"the joint solve with trend {candidate.trend.name} broke down")
    return plain.state


def _solve(
    model: Model, density: LogDensity, state: State, seen: Observations, hyperparameters: Hyperparameters
) -> Settled:
    precision = hyperparameters.precision(density, model.basis.frequencies, model.trend_precision())
    solution = minimise(model, state, seen, precision, Loss(hyperparameters.noise), most_steps=20, tolerance=1e-3)
    if solution is None:
        raise SolveError(f"the joint solve with trend {model.trend.name} broke down")
    linear = model.linearise(solution.state, seen, solution.prediction)
    equations = eliminate(linear, solution.prediction.residual, seen.weight**2, seen)
    frequencies, prior = model.basis.frequencies, model.trend_precision()
    problem = linearised(equations, seen.boards, solution.state.globals, frequencies, prior)
    return Settled(model, solution, equations, problem, hyperparameters, -np.inf, precision)


def _length_scale(hyperparameters: Hyperparameters) -> float:
    """The shortest; infinite where the process is off."""
    return float(np.exp(hyperparameters.kernel[1:].min(initial=np.inf)))


def _resolved(hyperparameters: Hyperparameters) -> float:
    return max(FINEST, SAFETY * _length_scale(hyperparameters))


def _basis(setting: Setting, hyperparameters: Hyperparameters, resolved: float) -> SineBasis:
    if not len(hyperparameters.kernel):
        return no_basis(setting.half_size)
    return sine_basis(setting.half_size, resolved)


def _logarithms(hyperparameters: Hyperparameters) -> Floats:
    return np.append(hyperparameters.kernel, np.log(hyperparameters.noise))
