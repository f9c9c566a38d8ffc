"""Which trend: every family is solved once at its highest order, and its lower orders are read off by linear
algebra.

The orders of a family are nested, so the evidence of a lower one follows from the same normal equations with
the higher coefficients held at zero. The process is added to the linearised problem; only the winner is
solved in full.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.refinement.basis import SineBasis, no_basis, sine_basis
from pinholify.refinement.evidence import (
    Fit,
    Hyperparameters,
    Linearised,
    linearised,
    maximise_evidence,
    nested,
    nested_noise,
    posterior,
    process_averaged,
)
from pinholify.refinement.model import Model, State
from pinholify.refinement.normal import eliminate
from pinholify.refinement.observations import Observations
from pinholify.refinement.shape import BoardShape
from pinholify.refinement.solver import Loss, Solution, minimise
from pinholify.refinement.spectral import LogDensity
from pinholify.refinement.trends import Search, Trend
from pinholify.refinement.trends.fitting import fit_trend, levelling_rotation

SCREENING_LENGTH_SCALE = 0.25  # the shortest that screening resolves, in half diagonals of the image
FIRST_LENGTH_SCALE = 0.4
MAX_SCREENING_STEPS = 15  # a trend that is not at its end by then is not the lens's
SCREENING_TOLERANCE = 0.5  # nats from its end a trend is near enough: its linearised problem knows the rest
IMAGE_GRID = 15
FOLD_MARGIN = 1.1  # of the image, in which a trend had better be one to one
ENDS_INSIDE_COST = np.log(1.25)  # nats a coordinate: a trend that ends within the image has to leave a fifth less noise
MIN_PROCESS_RATIO = 0.05  # of the noise: a process as weak as this is no start for another trend's
EXTENSION_COST = 3.0  # nats that the process must bring for its two parameters
MAX_NOISE_RATIO = 2.0  # times the noise that a leader promised
EVIDENCE_DOUBT = 3.0  # nats: of trends that the corners hardly tell apart the more general promises less
FREE_PRIOR_STD = 0.01  # standard deviation of a prior that leaves a parameter free
MAX_CONTENDERS, EVIDENCE_WINDOW = 3, 15.0  # how many of the best get a closer look, and how many nats behind the best


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What all candidates share: the ``density`` of the kernel with its number of ``scales``, the ``shape``,
    ``half_size`` (2,) of the image, ``covered`` (n, 2) points of it all over the part that corners cover,
    ``shortest`` of the length scale's prior, and the ``motion`` of boards in units of the noise.
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
        """Points (n, 2) all over the image, and a little beyond."""
        u, v = (FOLD_MARGIN * half * np.linspace(-1.0, 1.0, IMAGE_GRID) for half in self.half_size)
        return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)

    def model(self, trend: Trend, basis: SineBasis | None = None) -> Model:
        """The joint model with ``trend``; without a process unless ``basis`` is given."""
        return Model(trend, no_basis(self.half_size) if basis is None else basis, self.shape, self.motion)


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
    ends_in_image: bool

    @property
    def on(self) -> bool:
        """Whether it has the process."""
        return len(self.hyperparameters.kernel) > 0

    @property
    def generality(self) -> tuple[bool, int, int, int]:
        """What makes one candidate more general than another: the process, the trend's order, its other parameters."""
        return self.on, *_generality(self.trend)

    @property
    def name(self) -> str:
        """The trend, and ``+gp`` where the process is on."""
        return self.trend.name + ("+gp" if self.on else "")

    @property
    def score(self) -> float:
        """What candidates are compared by: a process has to be worth its two parameters, and a trend that does not
        reach the image's corners has to be far better than one that does.
        """
        cost = (EXTENSION_COST if self.on else 0.0) + (ENDS_INSIDE_COST * self.problem.rows if self.ends_in_image else 0.0)
        return self.log_evidence - cost


def solve_trend(
    setting: Setting,
    trend: Trend,
    known: Solution,
    seen: Observations,
    *,
    most_steps: int = 30,
    tolerance: float = 0.02,
) -> Solution | None:
    """The joint solve of ``trend`` alone from the rays that ``known`` gives its corners; None where it does
    not fit.
    """
    at = known.prediction  # where it sees them: a process that it has is for the trend to make good
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
    """:func:`solve_trend` for some of the corners, and the one step that makes up for what the others say."""
    near = solve_trend(setting, trend, known, seen.thinned(), tolerance=SCREENING_TOLERANCE)
    if near is None:
        return None
    return minimise(near.model, near.state, seen, near.model.trend_precision(), Loss(), most_steps=1)


def linearise_with(setting: Setting, solution: Solution, basis: SineBasis, seen: Observations) -> Linearised:
    """The linearised problem around a solution without process, with the functions of ``basis`` at weight
    zero.
    """
    state, trend = solution.state, solution.model.trend
    widened = setting.model(trend, basis)
    state = replace(state, weights=np.zeros((len(basis), 2)))
    linear = widened.linearise(state, seen, solution.prediction)
    equations = eliminate(linear, solution.prediction.residual, seen.weight**2, seen)
    return linearised(equations, seen.boards, state.globals, basis.frequencies, widened.trend_precision())


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A ``search`` whose general trend is solved without process, and the best of the trends within it."""

    search: Search
    solution: Solution
    plain: Candidate


def solve(setting: Setting, search: Search, known: Solution, seen: Observations) -> Solved | None:
    """``search`` without process; None where it does not fit."""
    solution = solve_trend(setting, search.general, known, seen, most_steps=MAX_SCREENING_STEPS, tolerance=SCREENING_TOLERANCE)
    if solution is None:
        return None
    try:
        alone = linearise_with(setting, solution, no_basis(setting.half_size), seen)
    except np.linalg.LinAlgError:  # it ran away to where a pose no longer matters
        return None
    plain = _without_process(setting, solution, alone, search.within, solution.noise)
    return None if plain is None else Solved(search, solution, plain)


def _without_process(
    setting: Setting,
    solution: Solution,
    alone: Linearised,
    trends: Sequence[Trend],
    noise: float,
    doubt: float = 0.0,
) -> Candidate | None:
    """The best of ``trends`` that is one to one where there are corners, each at its own noise, from ``noise``."""
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
    """The order of choice (n,): by evidence, but of those within ``doubt`` of the best the most general first."""
    doubtful = log_evidence >= log_evidence.max() - doubt
    order, free, held = (
        np.where(doubtful, values, 0) for values in np.array([_generality(trend) for trend in trends]).T
    )
    return np.lexsort((-log_evidence, -held, -free, -order, ~doubtful))


def _generality(trend: Trend) -> tuple[int, int, int]:
    """The order of its radial law, of which a wrong one costs most; how many parameters its prior leaves free; and less
    the more others it has, which are not to be had for nothing.
    """
    free = int((trend.prior_std > FREE_PRIOR_STD).sum())
    return trend.order, free, free - len(trend.prior_std)


def _removed(general: Trend, trends: Sequence[Trend], problem: Linearised) -> Bools:
    """Which of the globals (D,) of ``general`` each of the smaller ``trends`` (n,) lacks: (n, D)."""
    removed = np.zeros((len(trends), len(problem.theta)), dtype=bool)
    first = 2 * len(problem.frequencies)
    kept = np.array([general.kept(trend) for trend in trends])
    removed[:, first : first + kept.shape[1]] = ~kept
    return removed


def _candidate(
    setting: Setting, trend: Trend, theta: Floats, solution: Solution, problem: Linearised, fit: Fit
) -> Candidate | None:
    """None where the trend, its β the first of ``theta``, is not one to one even where there are corners."""
    beta = theta[: len(trend.prior_std)]
    if trend.folds(beta, setting.covered):
        return None
    ends = trend.folds(beta, setting.image)
    return Candidate(trend, fit.hyperparameters, fit.log_evidence, problem, solution, ends)


def candidates(
    setting: Setting, stages: Sequence[Sequence[Search]], known: Solution, seen: Observations
) -> Iterator[Candidate]:
    """Candidates of all searches, with and without process, as they are found, by some of the corners.

    A later stage is solved only where no trend of those before suffices without the process.
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
    """A process as strong as what a trend leaves."""
    noise = plain.hyperparameters.noise
    return Hyperparameters(np.log([noise, *[FIRST_LENGTH_SCALE] * setting.scales]), noise)


def _strong_enough(hyperparameters: Hyperparameters) -> Hyperparameters | None:
    """None where the process has died, from where no search finds back."""
    return hyperparameters if np.exp(hyperparameters.kernel[0]) > MIN_PROCESS_RATIO * hyperparameters.noise else None


def _with_process(
    setting: Setting, solved: Solved, start: Hyperparameters | None, seen: Observations, needed: float
) -> Candidate | None:
    """The best trend of the search with the process, chosen with the hyperparameters of another search; those of its
    own are not looked for where the evidence ``needed`` is out of reach.
    """
    whole = linearise_with(setting, solved.solution, sine_basis(setting.half_size, SCREENING_LENGTH_SCALE), seen)
    start = start or _fitted(setting, whole, _first_guess(setting, solved.plain)).hyperparameters
    return _best_at(setting, solved.solution, whole, solved.search.within, start, needed)


def _best_at(
    setting: Setting,
    solution: Solution,
    whole: Linearised,
    trends: Sequence[Trend],
    start: Hyperparameters,
    needed: float = -np.inf,
    doubt: float = 0.0,
) -> Candidate | None:
    """The best of ``trends`` within ``whole`` at the hyperparameters ``start``, with its own; the process is on."""
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


def _fitted(setting: Setting, problem: Linearised, start: Hyperparameters, needed: float = -np.inf) -> Fit:
    return maximise_evidence(
        problem,
        setting.density,
        start,
        shortest=setting.shortest,
        resolved=SCREENING_LENGTH_SCALE,
        most=8,
        needed=needed,
    )


def contest(
    setting: Setting, stages: Sequence[Sequence[Search]], tried: Sequence[Candidate], seen: Observations
) -> list[Candidate]:
    """The best of each of the leading searches after a closer look, best first.

    Far from where it was linearised a trend's evidence is only rough, so each leader is solved for itself and
    compared with its neighbours anew; where none near the best holds what it promised, those farther behind are too.
    """
    orders = {trend.order for searches in stages for search in searches for trend in search.within}
    leaders: dict[int, Candidate] = {}
    for candidate in sorted(tried, key=lambda candidate: -candidate.score):
        leaders.setdefault(id(candidate.origin), candidate)
    ranked = sorted(leaders.values(), key=lambda candidate: -candidate.score)
    looks: dict[Search, Candidate | None] = {}
    for leader in ranked:
        held = [found for found in looks.values() if found]
        near = leader.on or leader.score > ranked[0].score - EVIDENCE_WINDOW  # a strong process is not nearly linear
        if len(held) >= MAX_CONTENDERS or (held and not near):
            break
        if (around := leader.trend.around()) not in looks:
            looks[around] = _closer(setting, leader, orders, seen)
    finalists = _by_doubt([found for found in looks.values() if found])
    return [_retested(setting, finalists[0], seen), *finalists[1:]] if finalists else []


def _by_doubt(finalists: list[Candidate]) -> list[Candidate]:
    """Best first; of those that the evidence hardly tells from the best the most general before it.

    Trends that fit alike may be pixels apart where no two boards tell, and each one's error bars know only itself.
    """
    limit = max((candidate.score for candidate in finalists), default=0.0) - EVIDENCE_DOUBT
    by_score = sorted(finalists, key=lambda candidate: -candidate.score)
    doubtful = [candidate for candidate in by_score if candidate.score >= limit]
    return sorted(doubtful, key=lambda candidate: candidate.generality, reverse=True) + by_score[len(doubtful) :]


def _retested(setting: Setting, best: Candidate, seen: Observations) -> Candidate:
    """``best``, with the process where all corners ask for it although some did not."""
    if best.on:
        return best
    whole = linearise_with(setting, best.origin, sine_basis(setting.half_size, SCREENING_LENGTH_SCALE), seen)
    found = _best_at(setting, best.origin, whole, [best.trend], _first_guess(setting, best))
    return found if found and found.score > best.score else best


def _closer(
    setting: Setting, leader: Candidate, orders: Container[int], seen: Observations
) -> Candidate | None:
    """The best trend around ``leader``, linearised where that is solved; None where it leaves far more than there."""
    search = leader.trend.around()
    solution = solve_thinned(setting, search.general, leader.origin, seen)
    if solution is None:
        return None
    trends = [trend for trend in search.within if trend.order in orders]
    basis = sine_basis(setting.half_size, SCREENING_LENGTH_SCALE) if leader.on else no_basis(setting.half_size)
    whole = linearise_with(setting, solution, basis, seen)
    found = [_without_process(setting, solution, whole.without_process(), trends, leader.hyperparameters.noise, EVIDENCE_DOUBT)]
    if leader.on:
        found.append(_best_at(setting, solution, whole, trends, leader.hyperparameters, doubt=EVIDENCE_DOUBT))
    best = next(iter(_by_doubt([candidate for candidate in found if candidate])), None)
    holds = best is not None and best.hyperparameters.noise < MAX_NOISE_RATIO * leader.hyperparameters.noise
    return best if holds else None
