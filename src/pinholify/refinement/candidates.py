"""The choice of the trend by evidence: each family is solved at its highest order, and the rest is linear algebra.

The orders of a family are nested, so the evidence of a lower one follows from the same normal equations with the higher
coefficients fixed at zero (:func:`candidates`). The process is added to the linearised problem. The best of these get a
closer look, solved for themselves and compared with similar trends (:func:`contest`); only the winner is solved in full
(:mod:`pinholify.refinement.settle`).
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.geometry import grid_points
from pinholify.refinement.basis import SineBasis, no_basis, sine_basis
from pinholify.refinement.evidence import (
    Fit,
    Hyperparameters,
    ReducedProblem,
    maximise_evidence,
    nested,
    nested_noise,
    posterior,
    process_averaged,
    reduced_problem,
)
from pinholify.refinement.model import Model, State
from pinholify.refinement.observations import Observations
from pinholify.refinement.shape import BoardShape
from pinholify.refinement.solver import Loss, Solution, minimise
from pinholify.refinement.spectral import LogDensity
from pinholify.refinement.trends import Search, Trend
from pinholify.refinement.trends.fitting import fit_trend, levelling_rotation

SCREENING_LENGTH_SCALE = 0.25  # the shortest that screening resolves, in half diagonals of the image
FIRST_LENGTH_SCALE = 0.4  # half diagonals
MAX_SCREENING_STEPS = 15  # a trend that has not converged by then is not the lens's
SCREENING_TOLERANCE = 0.5  # nats: closer to its minimum, the linearised problem supplies the rest
MAX_SCREENING_SCORING_STEPS = 8  # of the hyperparameters
IMAGE_GRID = 15  # points along each side of the image where trends must not fold
FOLD_MARGIN = 1.1  # of that grid, relative to the image
ENDS_INSIDE_COST = np.log(1.25)  # nats per coordinate: a trend that ends in the image must leave a fifth less noise
MIN_PROCESS_RATIO = 0.05  # to the noise: a weaker process is no start for another trend's
EXTENSION_COST = 3.0  # nats by which the process, or a part of the board's shape, must raise the evidence
MAX_NOISE_RATIO = 2.0  # of a leader's noise after the closer look to that before
EVIDENCE_DOUBT = 3.0  # nats: among trends that differ by less the more general is preferred, which claims less
FREE_PRIOR_STD = 0.01  # a wider prior leaves its parameter free
MAX_CONTENDERS = 3  # candidates that hold in a closer look
EVIDENCE_WINDOW = 15.0  # nats behind the best: candidates farther behind get no closer look


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What all candidates share.

    ``density`` is the kernel's log spectral density and ``scales`` its number of length scales, ``shape`` the board's
    family of shapes, ``half_size`` (2,) that of the image, ``covered`` (n, 2) are image points all over the part that
    corners cover, ``shortest`` is that of the length scales' prior, and ``motion`` the standard deviation of the
    boards' motions in units of the noise.
    """

    density: LogDensity
    scales: int
    shape: BoardShape
    half_size: Floats
    covered: Floats
    shortest: float
    motion: float = 0.0

    @property
    def image(self) -> Floats:
        """Normalised points (n, 2) all over the image and slightly beyond."""
        u, v = (FOLD_MARGIN * half * np.linspace(-1.0, 1.0, IMAGE_GRID) for half in self.half_size)
        return grid_points(u, v)

    def model(self, trend: Trend, basis: SineBasis | None = None) -> Model:
        """The joint model with ``trend``; without a process unless ``basis`` is given."""
        return Model(trend, no_basis(self.half_size) if basis is None else basis, self.shape, self.motion)


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A ``trend`` with its hyperparameters and evidence.

    ``problem`` is its linearised problem, ``origin`` the solution around which that was linearised, and
    ``ends_in_image`` whether the trend fails to be one to one in a part of the image without corners.
    """

    trend: Trend
    hyperparameters: Hyperparameters
    log_evidence: float
    problem: ReducedProblem
    origin: Solution
    ends_in_image: bool

    @property
    def on(self) -> bool:
        """Whether the process is on."""
        return len(self.hyperparameters.kernel) > 0

    @property
    def generality(self) -> tuple[bool, int, int, int]:
        """A sort key, higher for more general candidates: the process, the trend's order, its other parameters."""
        return self.on, *_generality(self.trend)

    @property
    def name(self) -> str:
        """The trend, and ``+gp`` where the process is on."""
        return self.trend.name + ("+gp" if self.on else "")

    @property
    def score(self) -> float:
        """The log evidence less the costs of a process and of a trend that ends in the image."""
        ends_cost = ENDS_INSIDE_COST * self.problem.rows if self.ends_in_image else 0.0
        return self.log_evidence - ((EXTENSION_COST if self.on else 0.0) + ends_cost)


def solve_trend(
    setting: Setting,
    trend: Trend,
    known: Solution,
    seen: Observations,
    *,
    most_steps: int = 30,
    tolerance: float = 0.02,
) -> Solution | None:
    """The joint solve of ``trend`` without process, from the rays of the corners in ``known``; None where it fails."""
    at = known.prediction  # with the displacement by its process, which the trend has to replace
    turn = levelling_rotation(at.image, at.camera) if trend.level else np.eye(3)
    model = setting.model(trend)
    near = trend.resembling(known.model.trend, known.state.beta)
    beta = fit_trend(trend, at.image, at.camera @ turn.T, near)
    if beta is None:
        return None
    state = State(
        weights=np.zeros((0, 2)),
        beta=beta,
        eta=setting.shape.carried(known.state.eta, known.model.shape),
        rotations=turn @ known.state.rotations,
        translations=known.state.translations @ turn.T,
        motions=known.state.motions @ turn.T,
    )
    return minimise(model, state, seen, model.trend_precision(), Loss(), most_steps=most_steps, tolerance=tolerance)


def solve_thinned(setting: Setting, trend: Trend, known: Solution, seen: Observations) -> Solution | None:
    """:func:`solve_trend` by some of the corners, and then one step by all of them."""
    near = solve_trend(setting, trend, known, seen.thinned(), tolerance=SCREENING_TOLERANCE)
    if near is None:
        return None
    return minimise(near.model, near.state, seen, near.model.trend_precision(), Loss(), most_steps=1)


def linearise_with(setting: Setting, solution: Solution, basis: SineBasis, seen: Observations) -> ReducedProblem:
    """The linearised problem around a solution without process, with the functions of ``basis`` at weight zero."""
    widened = setting.model(solution.model.trend, basis)
    state = replace(solution.state, weights=np.zeros((len(basis), 2)))
    return reduced_problem(widened, state, seen, solution.prediction)[0]


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A ``search`` with the ``solution`` of its general trend, without process, and the best trend within it."""

    search: Search
    solution: Solution
    plain: Candidate


def solve(setting: Setting, search: Search, known: Solution, seen: Observations) -> Solved | None:
    """``search`` solved without process; None where that fails."""
    solution = solve_trend(
        setting, search.general, known, seen, most_steps=MAX_SCREENING_STEPS, tolerance=SCREENING_TOLERANCE
    )
    if solution is None:
        return None
    try:
        alone = linearise_with(setting, solution, no_basis(setting.half_size), seen)
    except np.linalg.LinAlgError:  # the solve diverged to where a pose has no effect
        return None
    plain = _without_process(setting, solution, alone, search.within, solution.noise)
    return None if plain is None else Solved(search, solution, plain)


def _without_process(
    setting: Setting,
    solution: Solution,
    alone: ReducedProblem,
    trends: Sequence[Trend],
    noise: float,
    doubt: float = 0.0,
) -> Candidate | None:
    """The best of ``trends``, each at its own noise, that is one to one where there are corners.

    ``noise`` is where the search for theirs starts; among trends within ``doubt`` nats the most general is preferred.
    """
    removed = _removed(solution.model.trend, trends, alone)
    found = nested_noise(alone, ~removed, noise)
    best: Candidate | None = None
    for i in _preferred(found.log_evidence, trends, doubt):
        if best is not None and best.score >= found.log_evidence[i] - doubt:
            break
        fit = Fit(Hyperparameters(np.empty(0), float(found.noise[i])), float(found.log_evidence[i]))
        beta = found.theta[i][~removed[i]]
        candidate = _candidate(setting, trends[i], beta, solution, alone.without(removed[i]), fit)
        if candidate is not None and (best is None or candidate.score > best.score):
            best = candidate
    return best


def _preferred(log_evidence: Floats, trends: Sequence[Trend], doubt: float) -> Ints:
    """Indices (n,) in order of preference: by evidence, but the most general first of those within ``doubt``."""
    doubtful = log_evidence >= log_evidence.max() - doubt
    order, free, held = (
        np.where(doubtful, values, 0) for values in np.array([_generality(trend) for trend in trends]).T
    )
    return np.lexsort((-log_evidence, -held, -free, -order, ~doubtful))


def _generality(trend: Trend) -> tuple[int, int, int]:
    """A sort key, higher for more general trends.

    First comes the order, since too low a one costs most, then the number of parameters that the prior leaves free, and
    last minus the number of the others, which bring nothing for their cost.
    """
    free = int((trend.prior_std > FREE_PRIOR_STD).sum())
    return trend.order, free, free - len(trend.prior_std)


def _removed(general: Trend, trends: Sequence[Trend], problem: ReducedProblem) -> Bools:
    """Mask (n, D) of the globals (D,) of the ``general`` trend that each of the n smaller ``trends`` lacks."""
    removed = np.zeros((len(trends), len(problem.theta)), dtype=bool)
    first = 2 * len(problem.frequencies)
    kept = np.array([general.kept(trend) for trend in trends])
    removed[:, first : first + kept.shape[1]] = ~kept
    return removed


def _candidate(
    setting: Setting, trend: Trend, theta: Floats, solution: Solution, problem: ReducedProblem, fit: Fit
) -> Candidate | None:
    """``trend`` as a candidate, with its β at the head of ``theta``; None where it folds among the corners."""
    beta = theta[: len(trend.prior_std)]
    if trend.folds(beta, setting.covered):
        return None
    ends = trend.folds(beta, setting.image)
    return Candidate(trend, fit.hyperparameters, fit.log_evidence, problem, solution, ends)


def candidates(
    setting: Setting, stages: Sequence[Sequence[Search]], known: Solution, seen: Observations
) -> Iterator[Candidate]:
    """The candidates of all searches, with and without process, as they are found, by some of the corners.

    A later stage is solved only where no trend of the earlier ones suffices without the process.
    """
    seen = seen.thinned()
    sufficient, start, best = False, None, -np.inf
    for searches in stages:
        if sufficient:
            return
        solved = [solve(setting, search, known, seen) for search in searches]
        for each in sorted(filter(None, solved), key=lambda one: -one.plain.score):
            best = max(best, each.plain.score)
            yield each.plain
            if sufficient:
                continue
            found = _with_process(setting, each, start, seen, best - EVIDENCE_WINDOW)
            if found is None:
                continue
            yield found
            sufficient = found.log_evidence < each.plain.log_evidence + EXTENSION_COST
            if start is None or found.score > best:
                start = _strong_enough(found.hyperparameters)
            best = max(best, found.score)


def _first_guess(setting: Setting, plain: Candidate) -> Hyperparameters:
    """Hyperparameters of a process as strong as the noise that ``plain`` leaves."""
    noise = plain.hyperparameters.noise
    return Hyperparameters(np.log([noise, *[FIRST_LENGTH_SCALE] * setting.scales]), noise)


def _strong_enough(hyperparameters: Hyperparameters) -> Hyperparameters | None:
    """``hyperparameters`` as a start for others; None where the process has vanished, which no search undoes."""
    return hyperparameters if np.exp(hyperparameters.kernel[0]) > MIN_PROCESS_RATIO * hyperparameters.noise else None


def _with_process(
    setting: Setting, solved: Solved, start: Hyperparameters | None, seen: Observations, needed: float
) -> Candidate | None:
    """The best trend of the search with the process, chosen at the hyperparameters ``start`` of another search.

    The search for its own hyperparameters stops early where the evidence ``needed`` is out of reach.
    """
    whole = linearise_with(setting, solved.solution, sine_basis(setting.half_size, SCREENING_LENGTH_SCALE), seen)
    start = start or _fitted(setting, whole, _first_guess(setting, solved.plain)).hyperparameters
    return _best_at(setting, solved.solution, whole, solved.search.within, start, needed)


def _best_at(
    setting: Setting,
    solution: Solution,
    whole: ReducedProblem,
    trends: Sequence[Trend],
    start: Hyperparameters,
    needed: float = -np.inf,
    doubt: float = 0.0,
) -> Candidate | None:
    """The best of ``trends`` within ``whole`` with the process: chosen at the hyperparameters ``start``, at its own."""
    general, first = solution.model.trend, 2 * len(whole.frequencies)
    removed = _removed(general, trends, whole)
    averaged = process_averaged(whole, setting.density, start)
    found = nested(averaged, ~removed[:, first:], np.full(len(trends), start.noise))
    for i in _preferred(found.log_evidence, trends, doubt):
        problem = whole.without(removed[i])
        fit = _fitted(setting, problem, start, needed)
        precision = fit.hyperparameters.precision(setting.density, problem.frequencies, problem.precision)
        theta = problem.theta + posterior(problem, precision, fit.hyperparameters.noise).delta
        candidate = _candidate(setting, trends[i], theta[first:], solution, problem, fit)
        if candidate is not None:
            return candidate
    return None


def _fitted(setting: Setting, problem: ReducedProblem, start: Hyperparameters, needed: float = -np.inf) -> Fit:
    """The hyperparameters of ``problem`` by a few steps from ``start``."""
    return maximise_evidence(
        problem,
        setting.density,
        start,
        shortest=setting.shortest,
        resolved=SCREENING_LENGTH_SCALE,
        most=MAX_SCREENING_SCORING_STEPS,
        needed=needed,
    )


def contest(
    setting: Setting, stages: Sequence[Sequence[Search]], tried: Sequence[Candidate], seen: Observations
) -> list[Candidate]:
    """The finalists: the best of each leading search after a closer look, best first.

    Far from where it was linearised the evidence of a trend is only approximate, so each leader is solved for itself
    and compared with similar trends anew. Leaders farther behind are looked at only where no closer one holds.
    """
    orders = {trend.order for searches in stages for search in searches for trend in search.within}
    leaders: dict[int, Candidate] = {}
    for candidate in sorted(tried, key=lambda candidate: -candidate.score):
        leaders.setdefault(id(candidate.origin), candidate)
    ranked = sorted(leaders.values(), key=lambda candidate: -candidate.score)
    looks: dict[Search, Candidate | None] = {}
    for leader in ranked:
        held = [found for found in looks.values() if found]
        # A strong process is badly linearised, so candidates that have it are always near.
        near = leader.on or leader.score > ranked[0].score - EVIDENCE_WINDOW
        if len(held) >= MAX_CONTENDERS or (held and not near):
            break
        if (around := leader.trend.around()) not in looks:
            looks[around] = _closer(setting, leader, orders, seen)
    finalists = _by_doubt([found for found in looks.values() if found])
    return [_retested(setting, finalists[0], seen), *finalists[1:]] if finalists else []


def _by_doubt(finalists: list[Candidate]) -> list[Candidate]:
    """``finalists``, best first, but those within :data:`EVIDENCE_DOUBT` of the best by generality.

    Trends that fit equally well may differ by pixels where few boards are, and the error bars of each assume that it is
    the right one; those of the most general are the most honest.
    """
    limit = max((candidate.score for candidate in finalists), default=0.0) - EVIDENCE_DOUBT
    by_score = sorted(finalists, key=lambda candidate: -candidate.score)
    doubtful = [candidate for candidate in by_score if candidate.score >= limit]
    return sorted(doubtful, key=lambda candidate: candidate.generality, reverse=True) + by_score[len(doubtful) :]


def _retested(setting: Setting, best: Candidate, seen: Observations) -> Candidate:
    """``best``, with the process where all corners favour it although a part of them did not."""
    if best.on:
        return best
    whole = linearise_with(setting, best.origin, sine_basis(setting.half_size, SCREENING_LENGTH_SCALE), seen)
    found = _best_at(setting, best.origin, whole, [best.trend], _first_guess(setting, best))
    return found if found and found.score > best.score else best


def _closer(
    setting: Setting, leader: Candidate, orders: Container[int], seen: Observations
) -> Candidate | None:
    """The best trend around ``leader``, linearised at its own solution; None where it leaves far more noise there."""
    search = leader.trend.around()
    solution = solve_thinned(setting, search.general, leader.origin, seen)
    if solution is None:
        return None
    trends = [trend for trend in search.within if trend.order in orders]
    basis = sine_basis(setting.half_size, SCREENING_LENGTH_SCALE) if leader.on else no_basis(setting.half_size)
    whole = linearise_with(setting, solution, basis, seen)
    noise = leader.hyperparameters.noise
    found = [_without_process(setting, solution, whole.without_process(), trends, noise, EVIDENCE_DOUBT)]
    if leader.on:
        found.append(_best_at(setting, solution, whole, trends, leader.hyperparameters, doubt=EVIDENCE_DOUBT))
    best = next(iter(_by_doubt([candidate for candidate in found if candidate])), None)
    holds = best is not None and best.hyperparameters.noise < MAX_NOISE_RATIO * noise
    return best if holds else None
