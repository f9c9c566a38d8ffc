"""Whether the board is warped, and by how much: first a test of errors that views share, then the evidence.

A warp has two prior standard deviations, along the board and across it. The problem is linearised once and the process
integrated out, so the evidence for any two of them costs one small Cholesky factor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.refinement.evidence import Hyperparameters, ReducedProblem, posterior, process_averaged, reduced_problem
from pinholify.refinement.observations import MANY_BOARDS, Observations
from pinholify.refinement.shape import WARP, BoardShape
from pinholify.refinement.sharing import SharedError, shared_error
from pinholify.refinement.solver import Solution
from pinholify.refinement.spectral import LogDensity

MAX_P_VALUE = 0.01  # of the shared error, for the warp to be considered
MIN_GAIN = 6.0  # nats by which a warp's two standard deviations must raise the evidence
FIRST_STD = 3e-3  # where their search starts, squares
STD_RANGE = (1e-5, 0.1)  # squares
MAX_TRIALS, TOLERANCE = 60, 0.05  # of the search; in log standard deviation, and in nats


@dataclass(frozen=True, slots=True, eq=False)
class Warp:
    """A ``shape`` with the warp of the highest evidence, and its ``gain`` in nats over the evidence without a warp."""

    shape: BoardShape
    gain: float


def warp_of(
    solution: Solution, shape: BoardShape, seen: Observations, density: LogDensity, hyperparameters: Hyperparameters
) -> BoardShape | None:
    """``shape`` with the warp that the residuals of ``solution`` indicate; None where they indicate none.

    Errors that views do not share are not taken for a warp, however well one would explain them: the errors of few
    boards, with each corner's assumed independent, can look like one.
    """
    if seen.boards < MANY_BOARDS or shared_by_boards(solution, seen).p_value > MAX_P_VALUE:
        return None
    state, model = solution.state, solution.model
    warped = shape.warped(FIRST_STD, FIRST_STD)
    if not warped.has(WARP):  # a board of no more than three corners
        return None
    widened = replace(model, shape=warped)
    state = replace(state, eta=warped.carried(state.eta, model.shape))
    problem = reduced_problem(widened, state, seen, solution.prediction)[0]
    warp = refitted(warped, problem, density, hyperparameters)
    return warp.shape if warp.gain > MIN_GAIN else None


def shared_by_boards(solution: Solution, seen: Observations) -> SharedError:
    """The error that views share in the residuals of ``solution``, in normalised image units."""
    state, model, weight = solution.state, solution.model, seen.weight[:, None]
    by_shift = weight[:, :, None] * model.by_point(state, seen, solution.prediction)
    return shared_error(weight * solution.prediction.residual, by_shift, seen.corner, seen.view)


def warp_rms(solution: Solution, seen: Observations) -> float:
    """RMS per axis of the warp's shifts of corners in the image, normalised and weighted; 0 without a warp."""
    state, model = solution.state, solution.model
    shift = model.shape.warp(state.eta)[seen.corner] * seen.placed[:, None]
    moved = (model.by_point(state, seen, solution.prediction) @ shift[:, :, None])[:, :, 0] * seen.weight[:, None]
    return float(np.sqrt((moved**2).mean()))


def refitted(shape: BoardShape, problem: ReducedProblem, density: LogDensity, hyperparameters: Hyperparameters) -> Warp:
    """The warped ``shape`` with the warp's standard deviations of highest evidence.

    The parameters of ``shape`` are the last unknowns of ``problem``.
    """
    from scipy.optimize import minimize  # slow to load, and most boards have no warp

    averaged = process_averaged(problem, density, hyperparameters)
    first = len(averaged.theta) - len(shape.part)
    groups = [np.append(np.zeros(first, dtype=bool), mask) for mask in _groups(shape)]

    def lost(logs: Floats) -> float:
        precision = np.array(averaged.precision)
        for group, log in zip(groups, logs, strict=True):
            precision[group] = np.exp(-2.0 * log)
        try:
            return -posterior(averaged, precision, hyperparameters.noise).log_evidence
        except np.linalg.LinAlgError:  # a warp too large for double precision
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
            "maxfev": MAX_TRIALS,
            "xatol": TOLERANCE,
            "fatol": TOLERANCE,
        },
    )
    without = averaged.without(groups[0] | groups[1])
    gain = -float(best.fun) - posterior(without, without.precision, hyperparameters.noise).log_evidence
    return Warp(shape.warped(*np.exp(best.x)), gain)


def _groups(shape: BoardShape) -> tuple[Bools, Bools]:
    """Masks (S,) of the parameters that are a warp's shifts along the board, and of those across it."""
    warp = shape.part == WARP
    return warp & (shape.axis < 2), warp & (shape.axis == 2)
