"""A trend fitted to known rays: the start of that trend's joint solve."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pinholify.arrays import Floats
from pinholify.charts import angles_to_directions, directions_to_angles
from pinholify.geometry import rotation_about_z, rotation_to_z
from pinholify.refinement.trends.base import Trend

MAX_STEPS = 25
FIRST_DAMPING, DAMPING_FACTOR = 1e-4, 10.0  # of Levenberg-Marquardt
RELATIVE_TOLERANCE = 1e-3  # decrease of the objective, relative to it, that ends the fit
FITTED_RAYS = 400  # about as many suffice for a start
ROUGH_NOISE = 1e-3  # normalised image units: what the priors are weighed against
MIN_PRIOR_STD = 0.1  # a tighter prior, good for a solve, would hold a start back


def fit_trend(trend: Trend, w: Floats, xyz: Floats, near: Floats | None = None) -> Floats | None:
    """The β (p,) of least squares in the image for rays ``xyz`` (n, 3) seen at ``w`` (n, 2), by Levenberg-Marquardt.

    The fit starts from ``near`` (p,) where that is given and better than the trend's own start: a strong lens has
    other minima, far from the right one. Rays that the chart does not reach are left out. None where fewer than half
    remain, or where the objective is not finite at the start.
    """
    c = trend.chart.coordinates(xyz)
    reached = np.isfinite(c).all(axis=1)
    if 2 * reached.sum() < len(c):
        return None
    some = np.flatnonzero(reached)[:: max(1, int(reached.sum()) // FITTED_RAYS)]
    c, w = c[some], w[some]
    precision, damping = (ROUGH_NOISE / np.maximum(trend.prior_std, MIN_PRIOR_STD)) ** 2, FIRST_DAMPING
    starts = [start for start in (trend.start(w, c), near) if start is not None]
    tried = [(start, *_objective(trend, start, w, c, precision)) for start in starts]
    beta, at, value = min(tried, key=lambda each: each[2])
    if not np.isfinite(value):
        return None
    for _ in range(MAX_STEPS):
        step = _step(trend, beta, w, c, at, precision, damping)
        trial_at, trial = _objective(trend, beta + step, w, c, precision)
        if not trial <= value:
            damping *= DAMPING_FACTOR
            continue
        gain, beta, at, value = value - trial, beta + step, trial_at, trial
        damping /= DAMPING_FACTOR
        if gain < RELATIVE_TOLERANCE * value:
            break
    return beta


def levelling_rotation(w: Floats, xyz: Floats) -> Floats:
    """The rotation (3, 3) of rays after which the image's middle looks along z and the image has no roll there.

    It is found from rays ``xyz`` (n, 3) seen at ``w`` (n, 2), by a polynomial of degree 5 fitted to their angles.
    """
    powers = np.array([(j, k) for j in range(6) for k in range(6 - j)])
    monomials = w[:, :1] ** powers[:, 0] * w[:, 1:] ** powers[:, 1]
    coefficients = np.linalg.lstsq(monomials, directions_to_angles(xyz), rcond=1e-9)[0]
    tilt = rotation_to_z(angles_to_directions(coefficients[:1])[0])
    coefficients = np.linalg.lstsq(monomials, directions_to_angles(xyz @ tilt.T), rcond=1e-9)[0]
    slope = coefficients[[np.flatnonzero((powers == p).all(axis=1))[0] for p in ((1, 0), (0, 1))]]  # rows by u, by v
    angle = np.arctan2(slope[0, 1] - slope[1, 0], slope[0, 0] + slope[1, 1])
    return rotation_about_z(angle) @ tilt


def _objective(trend: Trend, beta: Floats, w: Floats, c: Floats, precision: Floats) -> tuple[Floats, float]:
    at = trend.image(beta, c, w)
    value = float(((w - at) ** 2).sum() + precision @ beta**2)
    return at, value if np.isfinite(value) else np.inf


def _step(trend: Trend, beta: Floats, w: Floats, c: Floats, at: Floats, precision: Floats, damping: float) -> Floats:
    rows = trend.jacobians(beta, at, c)[1].reshape(-1, len(beta))
    matrix = rows.T @ rows
    matrix += np.diag(precision + damping * np.diag(matrix))
    right = rows.T @ (w - at).ravel() - precision * beta
    return np.asarray(cho_solve(cho_factor(matrix), right))
