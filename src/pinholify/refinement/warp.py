"""How large the warp of the board is, in its plane and across it: by the evidence, as everything else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.refinement.evidence import Hyperparameters, Linearised, linearised, posterior, process_averaged
from pinholify.refinement.normal import eliminate
from pinholify.refinement.observations import MANY_BOARDS, Observations
from pinholify.refinement.shape import WARP, BoardShape
from pinholify.refinement.sharing import SharedError, shared_error
from pinholify.refinement.solver import Solution
from pinholify.refinement.spectral import LogDensity

ALIKE = 0.01  # p-value: boards whose corners are off alike by chance are rarer
WORTH = 6.0  # nats that a warp has to bring for its two sizes
FIRST_STD = 3e-3  # squares
STD_RANGE = (1e-5, 0.1)
MOST_TRIALS, TOLERANCE = 60, 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Warp:
    """A ``shape`` with a warp of the highest evidence, and by how many nats that exceeds the evidence without."""

    shape: BoardShape
    gain: float


def warp_of(
    solution: Solution, shape: BoardShape, seen: Observations, density: LogDensity, hyperparameters: Hyperparameters
) -> BoardShape | None:
    """``shape`` with the warp that what ``solution`` leaves of the corners asks for; None where it asks for none.

    What the boards do not have in common is no warp, however well one would explain it: few boards' own errors, each
    corner's taken for independent, can look like one.
    """
    if seen.boards < MANY_BOARDS or shared_by_boards(solution, seen).p_value > ALIKE:
        return None
    state, model = solution.state, solution.model
    warped = shape.warped(FIRST_STD, FIRST_STD)
    if not warped.has(WARP):  # a board of three corners
        return None
    widened = replace(model, shape=warped)
    state = replace(state, eta=warped.carried(state.eta, model.shape))
    linear = widened.linearise(state, seen, solution.prediction)
    equations = eliminate(linear, solution.prediction.residual, seen.weight**2, seen)
    precision = widened.trend_precision()
    problem = linearised(equations, seen.boards, state.globals, model.basis.frequencies, precision)
    warp = refitted(warped, problem, density, hyperparameters)
    return warp.shape if warp.gain > WORTH else None


def shared_by_boards(solution: Solution, seen: Observations) -> SharedError:
    """What boards have in common of what ``solution`` leaves, in normalised image units."""
    state, model, weight = solution.state, solution.model, seen.weight[:, None]
    by_shift = weight[:, :, None] * model.by_point(state, seen, solution.prediction)
    return shared_error(weight * solution.prediction.residual, by_shift, seen.corner, seen.view)


def warp_rms(solution: Solution, seen: Observations) -> float:
    """What the board's warp shifts its corners by in the image: rms an axis, normalised; 0 of a board without."""
    state, model = solution.state, solution.model
    shift = model.shape.warp(state.eta)[seen.corner] * seen.placed[:, None]
    moved = (model.by_point(state, seen, solution.prediction) @ shift[:, :, None])[:, :, 0] * seen.weight[:, None]
    return float(np.sqrt((moved**2).mean()))


def refitted(shape: BoardShape, problem: Linearised, density: LogDensity, hyperparameters: Hyperparameters) -> Warp:
    """The ``shape``, the last of the unknowns of ``problem``, with its warp as large as the evidence has it."""
    from scipy.optimize import minimize  # slow to load, and most boards need none

    averaged = process_averaged(problem, density, hyperparameters)
    first = len(averaged.theta) - len(shape.part)
    groups = [np.append(np.zeros(first, dtype=bool), mask) for mask in _groups(shape)]

    def lost(logs: Floats) -> float:
        precision = np.array(averaged.precision)
        for group, log in zip(groups, logs, strict=True):
            precision[group] = np.exp(-2.0 * log)
        try:
            return -posterior(averaged, precision, hyperparameters.noise).log_evidence
        except np.linalg.LinAlgError:  # too large for double precision: not a place to be
            return np.inf

    low, high = np.log(STD_RANGE)
    start = np.clip(np.log([shape.prior_std[mask][0] for mask in _groups(shape)]), low, high - 1.0)
    best = minimize(
        lost,
        start,
        method="Nelder-Mead",
        bounds=[(low, high)] * 2,
        options={
            "initial_simplex": start + np.array([[0, 0], [1, 0], [0, 1]]),
            "maxfev": MOST_TRIALS,
            "xatol": TOLERANCE,
            "fatol": TOLERANCE,
        },
    )
    without = averaged.without(groups[0] | groups[1])
    gain = -float(best.fun) - posterior(without, without.precision, hyperparameters.noise).log_evidence
    return Warp(shape.warped(*np.exp(best.x)), gain)


def _groups(shape: BoardShape) -> tuple[Bools, Bools]:
    """Which parameters are a warp's shifts along the board, and which those across it."""
    warp = shape.part == WARP
    return warp & (shape.axis < 2), warp & (shape.axis == 2)
