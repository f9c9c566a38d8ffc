"""The full solve without wrong corners and boards, each of which is tested against the others.

Before the choice of the trend, :func:`screen` removes corners that disagree with their neighbours. After it,
:func:`clean` alternates between the full solve and a verdict on every corner and board that was given, so that
a corner removed early can return.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.errors import CalibrationError
from pinholify.refinement.candidates import Candidate, Setting
from pinholify.refinement.model import State
from pinholify.refinement.observations import Observations
from pinholify.refinement.outliers import consistent, locally_consistent, misfitting_boards, with_enough
from pinholify.refinement.posing import reposed, righted
from pinholify.refinement.settle import Settled, settle
from pinholify.refinement.solver import Loss, Solution, lengths, minimise, robust_scale
from pinholify.refinement.start import ROBUST_LOSS, START_STEPS, with_poses_righted
from pinholify.refinement.trust import trusts

MAX_ROUNDS = 3
MIN_AGREEING_SHARE = 0.5  # of a board's corners, for any of them to be used
FAR_LIMIT = 4.0  # robust standard deviations: good corners beyond it have a small part of the sum of squares
SPOILT_NOISE_RATIO = 1.2  # of all corners' noise to that of the good ones; a strong lens's edge alone does not reach it
MIN_WEIGHT_RATIO = 1.1  # a smaller change of a board's weight is not worth another solve
RECHOICE_NOISE_RATIO = 1.02  # of the first noise to the last: beyond it the choice of the trend had been misled


@dataclass(frozen=True, slots=True, eq=False)
class Cleaned:
    """The finished solve of the corners ``seen``.

    ``everything`` holds all corners that were given, each board with its final weight. ``rechoose`` is True where
    the trend was chosen by corners that proved wrong, or by boards whose weight proved wrong, which may have hidden a
    part of the lens. ``residuals`` (n, 2), normalised, and ``inliers`` (n,) are those of all corners of the used views
    by name; ``misfits`` are the reasons why the other views were not used.
    """

    settled: Settled
    seen: Observations
    everything: Observations
    rechoose: bool
    residuals: Mapping[str, Floats]
    inliers: Mapping[str, Bools]
    misfits: Mapping[str, str]


def screen(first: Solution, everything: Observations) -> tuple[Observations, Solution]:
    """The corners that agree with their neighbours, and the ``first`` solution refined by them alone.

    A second pass finds wrong corners on boards whose poses the first solution did not have right yet.
    """
    seen, known = _screened(first, everything)
    return _screened(known, seen) if spoilt(known, seen) else (seen, known)


def _screened(first: Solution, everything: Observations) -> tuple[Observations, Solution]:
    """One pass of :func:`screen`."""
    keep = locally_consistent(first.model.predict(first.state, everything).residual, everything)
    share = everything.sums(keep.astype(float)) / everything.sums(np.ones(len(keep)))
    keep = with_enough(everything, keep & (share >= MIN_AGREEING_SHARE)[everything.view])
    if not keep.any():
        raise CalibrationError("the corners of no board agree with the others: check the board's size")
    seen = everything.select(keep)
    state = first.state.of_boards(np.isin(np.arange(everything.boards), everything.view[keep]))
    precision = first.model.trend_precision()
    some = seen.thinned()
    known = minimise(first.model, state, some, precision, ROBUST_LOSS, most_steps=START_STEPS)
    if known is None:
        raise CalibrationError("the joint solve broke down at its start: check the board's size")
    return seen, with_poses_righted(known, some)


def spoilt(solution: Solution, seen: Observations) -> bool:
    """Whether corners that disagree with their neighbours dominate the noise of ``solution``."""
    residual = solution.model.predict(solution.state, seen).residual
    length = lengths(residual, seen.weight)
    squared, near = length**2, length < FAR_LIMIT * robust_scale(length)
    if squared.sum() <= SPOILT_NOISE_RATIO**2 * squared[near].sum():
        return False
    keep = locally_consistent(residual, seen)
    return bool(squared.sum() > SPOILT_NOISE_RATIO**2 * squared[keep].sum())


def clean(setting: Setting, best: Candidate, seen: Observations, everything: Observations) -> Cleaned:
    """``best`` solved in full by ``seen``, then by the corners of ``everything`` that agree, until these stay the same.

    Raises SolveError where the solve breaks down, and CalibrationError where no board agrees with the others.
    """
    settled = settle(setting, best, seen)
    first_noise, unweighted, trust = settled.hyperparameters.noise, everything, np.ones(everything.boards)
    for _ in range(MAX_ROUNDS):
        before, trust = trust, _trusted(settled, seen, everything, trust)
        everything = unweighted.weighted(trust)
        state, residual = _judged(settled, seen, everything, trust)
        keep, misfits = _verdict(residual, settled.hyperparameters.noise, everything)
        if np.array_equal(everything.image[keep], seen.image) and not _differ(trust, before):
            break
        if not keep.any():
            raise CalibrationError("no board agrees with the others: check the board's size")
        seen = everything.select(keep)
        kept = np.isin(np.arange(everything.boards), everything.view[keep])
        best = replace(best, hyperparameters=settled.hyperparameters)
        setting = replace(setting, shape=settled.model.shape, motion=settled.model.motion)
        settled = settle(setting, best, seen, (state.of_boards(kept), settled.model.basis))
    state, residual = _judged(settled, seen, everything, trust)
    inside = dict(zip(everything.names, everything.slices(), strict=True))
    inlier = np.zeros(len(everything.view), dtype=bool)
    inlier[keep] = True
    return Cleaned(
        settled,
        seen,
        everything,
        _differ(trust, np.ones(1)) or first_noise > RECHOICE_NOISE_RATIO * settled.hyperparameters.noise,
        {name: residual[inside[name]] for name in seen.names},
        {name: inlier[inside[name]] for name in seen.names},
        misfits,
    )


def _trusted(settled: Settled, seen: Observations, everything: Observations, present: Floats) -> Floats:
    """The factors (K,) for the weights of all boards, from their ``present`` ones (K,).

    Boards that are set aside keep theirs, and all do where none changes by much.
    """
    used, found = np.isin(everything.names, seen.names), present.copy()
    found[used] = trusts(settled, seen, present[used])
    return found if _differ(found, present) else present


def _differ(weights: Floats, others: Floats) -> bool:
    """Whether any of ``weights`` (K,) differs enough from its counterpart to be worth another solve."""
    return bool(np.abs(np.log(weights / others)).max() > np.log(MIN_WEIGHT_RATIO))


def _judged(
    settled: Settled, seen: Observations, everything: Observations, trust: Floats
) -> tuple[State, Floats]:
    """The camera with the poses of all boards, and the residuals (N, 2) of all corners, nan where it has no ray.

    Boards that were set aside get poses by the finished camera, and so do those that fit badly: their weights include
    a ``trust`` (K,) that may be small because their poses were wrong.
    """
    model, camera = settled.model, settled.solution.state
    used = np.isin(everything.names, seen.names)
    state = reposed(model, camera, everything)
    poses = [np.array(each) for each in (state.rotations, state.translations, state.motions)]
    for of_all, of_used in zip(poses, (camera.rotations, camera.translations, camera.motions), strict=True):
        of_all[used] = of_used
    state = replace(state, **dict(zip(("rotations", "translations", "motions"), poses, strict=True)))
    seen_at_all = np.isfinite(model.predict(state, everything).residual).all(axis=1)
    aside = ~used & (everything.sums((~seen_at_all).astype(float)) == 0)
    if aside.any():
        some = everything.select(aside[everything.view])
        loss = Loss(settled.hyperparameters.noise, ROBUST_LOSS.huber)
        posed = minimise(model, state.of_boards(aside), some, settled.precision, loss, poses_only=True)
        if posed is not None:
            rotations, translations, motions = poses
            rotations[aside], translations[aside] = posed.state.rotations, posed.state.translations
            motions[aside] = posed.state.motions
    state = righted(model, state, everything.weighted(1.0 / trust), settled.precision)
    return state, model.predict(state, everything).residual


def _verdict(residual: Floats, noise: float, everything: Observations) -> tuple[Bools, dict[str, str]]:
    """Mask (N,) of the corners to keep, and by name the boards not to keep, with the reason."""
    keep = consistent(residual, noise, everything)
    misfits = {}
    for k, reason in misfitting_boards(residual, noise, everything).items():
        keep[everything.slices()[k]] = False
        misfits[everything.names[k]] = reason
    enough = with_enough(everything, keep)
    for k in set(everything.view[keep]) - set(everything.view[enough]):
        misfits[everything.names[k]] = "too few of its corners agree with the others"
    return enough, misfits
