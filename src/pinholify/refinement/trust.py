"""The noise of each board's corners, so that the worst photographs do not outweigh the others.

One board moved, another is slightly out of focus, a third is bent by hand, and the effect in px is larger the closer
the board. So each board has its own noise, log-normal about a common one, with a spread estimated from the boards
themselves (empirical Bayes); where chance explains their differences, the spread is zero.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from pinholify.arrays import Floats
from pinholify.geometry import POSE_DOF
from pinholify.refinement.observations import Observations
from pinholify.refinement.settle import Settled
from pinholify.refinement.solver import lengths, robust_scale

SIGNIFICANT_STDS = 4.0  # beyond chance: one in three hundred sets of equally noisy boards exceeds it
MEDIAN_LOG_VARIANCE = float(2.0 / np.log(2.0) ** 2)  # of a log variance by the median, times its degrees of freedom
MIN_FREEDOM = 4.0  # residuals beyond the unknowns: a board with fewer does not determine its noise


def trusts(settled: Settled, seen: Observations, present: Floats) -> Floats:
    """The factors (K,) for the weights of the boards: less than 1 where corners are noisier than those of others.

    ``present`` (K,) are the factors that the weights of ``seen`` include already. The mean inverse square of the
    factors over all corners is 1, so that the noise over all corners stays unchanged.
    """
    roughly = 2.0 * seen.sums(np.ones(len(seen.view))) - POSE_DOF
    if not _deviations(settled, seen, present, roughly).any():  # the exact freedom costs as much as a step of the solve
        return np.ones(seen.boards)
    found = np.exp(_deviations(settled, seen, present, _freedom(settled, seen)))
    return np.asarray(np.sqrt(found[seen.view].mean() / found))


def _deviations(settled: Settled, seen: Observations, present: Floats, freedom: Floats) -> Floats:
    """Deviations (K,) of the boards' log variances from the typical one, shrunk, for ``freedom`` (K,) residuals."""
    length = lengths(settled.solution.prediction.residual, seen.weight / present[seen.view])
    squares = np.array([robust_scale(length[rows]) for rows in seen.slices()]) ** 2  # wrong corners are not noise
    known = (freedom > MIN_FREEDOM) & (squares > 0.0)
    deviations = np.zeros(seen.boards)
    corrected = squares[known] * 2.0 * seen.sums(np.ones(len(length)))[known] / freedom[known]
    chance = MEDIAN_LOG_VARIANCE / freedom[known]
    typical, spread = _hierarchy(np.log(corrected), chance)
    deviations[known] = (np.log(corrected) - typical) * spread / (spread + chance)
    return deviations


def _hierarchy(log_variance: Floats, chance: Floats) -> tuple[float, float]:
    """The mean and the variance of the boards' true log variances, from the estimates ``log_variance`` (K,).

    ``chance`` (K,) is the variance of each estimate by chance. Where that explains their differences, the variance of
    the true ones is 0. (The moments of DerSimonian & Laird 1986.)
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
    """Residuals of each board (K,) less the unknowns that they determine: its pose and its share in the others."""
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
