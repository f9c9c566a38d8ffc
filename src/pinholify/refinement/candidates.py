"""Which trend: every family is solved once at its highest order, and its lower orders are read off by linear
algebra.

The orders of a family are nested, so the evidence of a lower one follows from the same normal equations with
the higher coefficients held at zero. The process is added to the linearised problem; only the winner is
solved in full.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.refinement.basis import SineBasis, no_basis, sine_basis
from pinholify.refinement.evidence import (
    Hyperparameters,
    Linearised,
    linearised,
    maximise_evidence,
    posterior,
)
from pinholify.refinement.model import Model, State
from pinholify.refinement.normal import eliminate
from pinholify.refinement.observations import Observations
from pinholify.refinement.shape import BoardShape
from pinholify.refinement.solver import Loss, Solution, minimise
from pinholify.refinement.spectral import LogDensity
from pinholify.refinement.trends import Trend
from pinholify.refinement.trends.fitting import fit_trend, levelling_rotation

SCREENING_LENGTH_SCALE = 0.2  # the shortest that screening resolves, in half diagonals of the image
FIRST_LENGTH_SCALE = 0.4
WORTH = 3.0  # nats that the process must bring for its two parameters
HOPELESS = 30.0  # nats behind, from where a family cannot win when the best one needs no process


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What all candidates share: the ``density`` of the kernel with its number of ``scales``, the ``shape``,

    ``half_size`` (2,) of the image, ``shortest`` of the length scale's prior.
    """

    density: LogDensity
    scales: int
    shape: BoardShape
    half_size: Floats
    shortest: float

    def model(self, trend: Trend, basis: SineBasis | None = None) -> Model:
        """The joint model with ``trend``; without a process unless ``basis`` is given."""
        return Model(trend, no_basis(self.half_size) if basis is None else basis, self.shape)


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A trend with hyperparameters and its evidence; the linearised ``problem`` and the ``origin`` it was
    linearised at.
    """

    trend: Trend
    hyperparameters: Hyperparameters
    log_evidence: float
    problem: Linearised
    origin: Solution

    @property
    def name(self) -> str:
        """The trend, and ``+gp`` where the process is on."""
        return self.trend.name + ("+gp" if len(self.hyperparameters.kernel) else "")


def solve_trend(
    setting: Setting, trend: Trend, known: Solution, seen: Observations, loss: Loss
) -> Solution | None:
    """The joint solve of ``trend`` alone from the rays that ``known`` gives its corners; None where it does
    not fit.
    """
    turn = (
        levelling_rotation(known.prediction.undisplaced, known.prediction.camera)
        if trend.level
        else np.eye(3)
    )
    model = setting.model(trend)
    beta = fit_trend(trend, known.prediction.undisplaced, known.prediction.camera @ turn.T)
    if beta is None:
        return None
    state = State(
        np.zeros((0, 2)),
        beta,
        known.state.eta,
        turn @ known.state.rotations,
        known.state.translations @ turn.T,
    )
    return minimise(model, state, seen, model.trend_precision(), loss)


def linearise_with(model: Model, solution: Solution, basis: SineBasis, seen: Observations) -> Linearised:
    """The linearised problem around a solution without process, with the functions of ``basis`` at weight
    zero.
    """
    state = solution.state
    widened = Model(model.trend, basis, model.shape)
    state = State(np.zeros((len(basis), 2)), state.beta, state.eta, state.rotations, state.translations)
    linear = widened.linearise(state, seen, solution.prediction)
    equations = eliminate(linear, solution.prediction.residual, seen.weight**2, seen)
    return linearised(equations, seen.boards, state.globals, basis.frequencies, model.trend_precision())


@dataclass(frozen=True, slots=True, eq=False)
class Family:
    """A family solved at its highest order, linearised with the process; and its orders without process, best
    first.
    """

    trend: Trend
    solution: Solution
    problem: Linearised
    orders: tuple[tuple[int, Candidate], ...]


def solve_family(
    setting: Setting, trends: Sequence[Trend], known: Solution, seen: Observations
) -> Family | None:
    """``trends`` of one family, rising in order, without process; None where none fits."""
    highest = trends[-1]
    solution = solve_trend(setting, highest, known, seen, Loss())
    if solution is None:
        return None
    basis = sine_basis(setting.half_size, SCREENING_LENGTH_SCALE)
    problem = linearise_with(setting.model(highest), solution, basis, seen)
    plain = problem.without_process()
    found = []
    for trend in trends:
        removed = _removed(highest, trend.order, plain)
        start = Hyperparameters(np.empty(0), solution.noise)
        candidate = _candidate(setting, trend, solution, plain.without(removed), start)
        if candidate is not None:
            found.append((trend.order, candidate))
    found.sort(key=lambda pair: -pair[1].log_evidence)
    return Family(highest, solution, problem, tuple(found)) if found else None


def with_process(
    setting: Setting, family: Family, plain: Candidate, start: Hyperparameters
) -> Candidate | None:
    """``plain``, an order of ``family``, with the process."""
    removed = _removed(family.trend, plain.trend.order, family.problem)
    problem = family.problem.without(removed)
    return _candidate(setting, plain.trend, family.solution, problem, start)


def first_hyperparameters(setting: Setting, noise: float, residual_std: float) -> Hyperparameters:
    """A start of the search: the process about as strong as what a trend leaves."""
    kernel = np.log([max(residual_std, noise), *[FIRST_LENGTH_SCALE] * setting.scales])
    return Hyperparameters(kernel, noise)


def _removed(highest: Trend, order: int, problem: Linearised) -> Bools:
    """Which of the globals an ``order`` lacks."""
    removed = np.zeros(len(problem.theta), dtype=bool)
    first = 2 * len(problem.frequencies)
    kept = highest.kept(order)
    removed[first : first + len(kept)] = ~kept
    return removed


def _candidate(
    setting: Setting, trend: Trend, solution: Solution, problem: Linearised, start: Hyperparameters
) -> Candidate | None:
    fit = maximise_evidence(
        problem, setting.density, start, shortest=setting.shortest, resolved=SCREENING_LENGTH_SCALE
    )
    best = fit.hyperparameters
    precision = best.precision(setting.density, problem.frequencies, problem.precision)
    theta = problem.theta + posterior(problem, precision, best.noise).delta
    m, p = 2 * len(problem.frequencies), len(trend.prior_std)
    if trend.folds(theta[m : m + p], setting.half_size):
        return None
    return Candidate(trend, best, fit.log_evidence, problem, solution)


def candidates(
    setting: Setting, families: dict[str, list[Trend]], known: Solution, seen: Observations
) -> Iterator[Candidate]:
    """Candidates of all families, with and without process, as they are found."""
    solved = [
        f for trends in families.values() if (f := solve_family(setting, trends, known, seen)) is not None
    ]
    solved.sort(key=lambda family: -family.orders[0][1].log_evidence)
    best, needed = -np.inf, True
    for family in solved:
        plain = family.orders[0][1]
        yield from (candidate for _, candidate in family.orders)
        if not needed and plain.log_evidence < best - HOPELESS:
            continue
        start = first_hyperparameters(setting, plain.hyperparameters.noise, plain.hyperparameters.noise)
        for _, order in family.orders:
            found = with_process(setting, family, order, start)
            if found is None:
                continue
            yield found
            start = found.hyperparameters
            gain = found.log_evidence - plain.log_evidence
            needed = needed and (gain > WORTH)
            best = max(best, found.log_evidence)
