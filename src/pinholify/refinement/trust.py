"""How noisy each board's corners are: photographs of one camera differ, and the worst must not outweigh the others.

One board moved, another lies a little out of focus, a third is held so that it bends, and the nearer it is the more px
that makes. So each board has a noise of its own, log-normal about what all have in common, with a spread that the
boards themselves tell (empirical Bayes); where chance explains how they differ, it is none.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from pinholify.arrays import Floats
from pinholify.geometry import POSE_DOF
from pinholify.refinement.observations import Observations
from pinholify.refinement.settle import Settled
from pinholify.refinement.solver import lengths, robust_scale

SIGNIFICANT_STDS = 4.0  # standard deviations beyond chance: of sets of boards alike one in three hundred seems uneven
MEDIAN_LOG_VARIANCE = float(2.0 / np.log(2.0) ** 2)  # variance of a log variance by the median, times its degrees of freedom
MIN_FREEDOM = 4.0  # residuals beyond the unknowns, below which a board tells nothing of its noise


def trusts(settled: Settled, seen: Observations, present: Floats) -> Floats:
    """By what to multiply each board's weights (K,): less than 1 where its corners are noisier than others'.

    ``present`` (K,) is by what they are multiplied in ``seen``. The mean of the inverse squares over all corners is 1,
    so that the noise stays what it is over all corners.
    """
    roughly = 2.0 * seen.sums(np.ones(len(seen.view))) - POSE_DOF
    if not _apart(settled, seen, present, roughly).any():  # the exact numbers take as long as a step of the solve
        return np.ones(seen.boards)
    found = np.exp(_apart(settled, seen, present, _freedom(settled, seen)))
    return np.asarray(np.sqrt(found[seen.view].mean() / found))


def _apart(settled: Settled, seen: Observations, present: Floats, freedom: Floats) -> Floats:
    """How far each board's log variance (K,) is from the typical one, for its degrees of ``freedom`` (K,)."""
    length = lengths(settled.solution.prediction.residual, seen.weight / present[seen.view])
    squares = np.array([robust_scale(length[rows]) for rows in seen.slices()]) ** 2  # wrong corners are no noise
    tells = (freedom > MIN_FREEDOM) & (squares > 0.0)
    apart = np.zeros(seen.boards)
    corrected = squares[tells] * 2.0 * seen.sums(np.ones(len(length)))[tells] / freedom[tells]
    chance = MEDIAN_LOG_VARIANCE / freedom[tells]
    typical, spread = _hierarchy(np.log(corrected), chance)
    apart[tells] = (np.log(corrected) - typical) * spread / (spread + chance)
    return apart


def _hierarchy(log_variance: Floats, chance: Floats) -> tuple[float, float]:
    """The mean and the variance of the boards' true log variances, by those found (K,) and the variance (K,) that
    ``chance`` adds to each; no variance where chance explains it all (the moments of DerSimonian & Laird 1986).
    """
    if len(log_variance) < 2:
        return 0.0, 0.0
    share = 1.0 / chance
    typical = float(share @ log_variance / share.sum())
    excess = float(share @ (log_variance - typical) ** 2) - (len(share) - 1)
    if excess < SIGNIFICANT_STDS * np.sqrt(2.0 * (len(share) - 1)):
        return typical, 0.0
    spread = excess / float(share.sum() - (share**2).sum() / share.sum())
    share = 1.0 / (chance + spread)
    return float(share @ log_variance / share.sum()), spread


def _freedom(settled: Settled, seen: Observations) -> Floats:
    """How many residuals of each board (K,) are left beyond its own pose and its share in the other unknowns."""
    weight = seen.weight[:, None, None]
    linear = settled.model.linearise(settled.solution.state, seen, settled.solution.prediction)
    cholesky = np.linalg.cholesky(settled.information)
    root = solve_triangular(cholesky, np.eye(len(cholesky)), lower=True, check_finite=False).T
    m = linear.basis.shape[1]
    moved = weight * (linear.shared @ root[2 * m :])
    moved[:, 0] += weight[:, 0] * (linear.basis @ root[:m])
    moved[:, 1] += weight[:, 0] * (linear.basis @ root[m : 2 * m])
    by_pose = settled.equations.cross @ root
    own = seen.sums((moved**2).sum(axis=(1, 2))) - (by_pose**2).sum(axis=(1, 2))
    return np.asarray(2.0 * seen.sums(np.ones(len(seen.view))) - POSE_DOF - own)
