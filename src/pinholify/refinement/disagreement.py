"""The disagreement of the boards: how much more they pull on the camera than their corners' noise explains.

The covariance of the joint solve takes the errors of all corners for independent. Those of one photograph may be
correlated: the board bends in the hand, its white blooms, the shutter rolls. Then each board pulls on the camera more
than its noise would, and the boards' pulls themselves show by how much (the covariance of clustered residuals, Liang &
Zeger 1986). Errors that all boards share do not show in it.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pinholify.arrays import Floats
from pinholify.geometry import POSE_DOF, inverse_2x2
from pinholify.refinement.maps import JointMap
from pinholify.refinement.model import Linearisation
from pinholify.refinement.observations import Observations
from pinholify.refinement.settle import Settled

PROBE_PIXELS = 24  # at least, whose rays the boards pull on
SIGNIFICANT_STDS = 3.0  # beyond chance


def disagreement(settled: Settled, seen: Observations, plane_map: JointMap) -> float:
    """The factor ≥ 1 by which the boards' pulls on rays exceed those expected from noise; 1 where chance explains them.

    The rays are those of some of the corners, without the rotation that they share.
    """
    state, solution = settled.solution.state, settled.solution
    noise = settled.hyperparameters.noise
    linear = settled.model.linearise(state, seen, solution.prediction)
    rays = _rays(plane_map, seen, len(settled.precision))
    moved = _moved(linear, cho_solve(cho_factor(settled.information), rays.T))
    pulls, spreads = [], []
    for rows in seen.slices():
        weight = np.repeat(seen.weight[rows], 2)[:, None]
        basis = np.linalg.qr(linear.pose[rows].reshape(len(weight), -1) * weight)[0]
        free = moved[rows].reshape(len(weight), -1) * weight
        free -= basis @ (basis.T @ free)  # what no change of pose can absorb
        pulls.append(free.T @ (solution.prediction.residual[rows].ravel() * weight[:, 0]) / noise)
        spreads.append(free.T @ free)
    return _factor(np.array(pulls), np.array(spreads))


def _rays(plane_map: JointMap, seen: Observations, unknowns: int) -> Floats:
    """∂(rays at some of the corners, in px, without the rotation that they share)/∂θ: (m, D)."""
    every = max(1, len(seen.image) // PROBE_PIXELS)
    uv = plane_map.frame.restore(seen.image[::every])
    to_px = inverse_2x2(plane_map.jacobian(uv))  # not finite where the map is not one to one
    features = (to_px @ plane_map.features(uv)).reshape(2 * len(uv), -1)
    features = features[np.isfinite(features).all(axis=1)]
    by_rest, turns = features[:, :-POSE_DOF], features[:, -POSE_DOF:-3]
    rays = np.zeros((len(features), unknowns))
    rays[:, : by_rest.shape[1]] = by_rest - turns @ (np.linalg.pinv(turns) @ by_rest)
    return rays


def _moved(linear: Linearisation, steps: Floats) -> Floats:
    """The shifts (N, 2, m) of the corners by ``steps`` (D, m) of the globals."""
    m = linear.basis.shape[1]
    displaced = np.stack([linear.basis @ steps[:m], linear.basis @ steps[m : 2 * m]], axis=1)
    return np.asarray(displaced + linear.shared @ steps[2 * m :])


def _factor(pulls: Floats, spreads: Floats) -> float:
    """The factor, from each board's ``pulls`` (K, m) on m rays and their covariances ``spreads`` (K, m, m) by noise."""
    expected = np.diagonal(spreads.sum(axis=0))
    pulled = expected > 1e-12 * expected.max(initial=0.0)
    if len(pulls) < 2 or not pulled.any():
        return 1.0
    scale = 1.0 / np.sqrt(expected[pulled] * pulled.sum())
    spreads = spreads[:, pulled][:, :, pulled] * (scale[:, None] * scale)
    found = float(((pulls[:, pulled] * scale) ** 2).sum()) * len(pulls) / (len(pulls) - 1.0)
    chance = float(np.sqrt(2.0 * (spreads**2).sum()))
    return float(np.sqrt(found)) if found > 1.0 + SIGNIFICANT_STDS * chance else 1.0
