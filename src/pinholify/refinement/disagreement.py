"""How much farther the boards pull the camera apart than their corners' noise explains.

The covariance of the joint solve takes every corner's error for its own. Those of one photograph may hang together: the
board bends as it is held, the light spreads its white, the shutter rolls. Then each board pulls the camera by more than
its noise would, and the boards' pulls themselves say by how much (the covariance of clustered residuals, Liang & Zeger
1986). What all boards have in common no such comparison sees.
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

PROBE_PIXELS = 24  # pixels whose rays are asked
SIGNIFICANT_STDS = 3.0  # standard deviations beyond chance


def disagreement(settled: Settled, seen: Observations, plane_map: JointMap) -> float:
    """The factor ≥ 1 by which the boards' pulls on the rays all over the corners, the best turn taken out, exceed what
    noise makes of them; 1 where chance explains it.
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
        free -= basis @ (basis.T @ free)  # what no pose makes good
        pulls.append(free.T @ (solution.prediction.residual[rows].ravel() * weight[:, 0]) / noise)
        spreads.append(free.T @ free)
    return _factor(np.array(pulls), np.array(spreads))


def _rays(plane_map: JointMap, seen: Observations, unknowns: int) -> Floats:
    """∂(rays at some of the corners, in px, the turn that they share taken out)/∂θ: (2 PROBE_PIXELS, D)."""
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
    """How ``steps`` (D, m) of the globals move each corner, (N, 2, m)."""
    m = linear.basis.shape[1]
    displaced = np.stack([linear.basis @ steps[:m], linear.basis @ steps[m : 2 * m]], axis=1)
    return np.asarray(displaced + linear.shared @ steps[2 * m :])


def _factor(pulls: Floats, spreads: Floats) -> float:
    """From each board's ``pulls`` (K, m) on m rays and their covariances ``spreads`` (K, m, m) by noise alone."""
    expected = np.diagonal(spreads.sum(axis=0))
    asked = expected > 1e-12 * expected.max(initial=0.0)
    if len(pulls) < 2 or not asked.any():
        return 1.0
    scale = 1.0 / np.sqrt(expected[asked] * asked.sum())
    spreads = spreads[:, asked][:, :, asked] * (scale[:, None] * scale)
    found = float(((pulls[:, asked] * scale) ** 2).sum()) * len(pulls) / (len(pulls) - 1.0)
    chance = float(np.sqrt(2.0 * (spreads**2).sum()))
    return float(np.sqrt(found)) if found > 1.0 + SIGNIFICANT_STDS * chance else 1.0
