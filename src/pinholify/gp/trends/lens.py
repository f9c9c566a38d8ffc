"""A lens-like trend: radial about a free centre, with a free ratio of its axes, then a homography.

h(x) = H · d (1 + k₁ r² + … + k_n r²ⁿ),  d = x − c,  r² = d_u²/ρ + ρ d_v².

The factors 1/ρ and ρ have product one, so r is of order one whatever ρ is, and one prior fits all radial coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.geometry import apply_homography, homography_jacobian, homography_parameter_jacobian
from pinholify.gp.trends.homography import PARAMETERS, Homography, matrix

CENTRE_STD = 0.3
LOG_RATIO_STD = 0.3
RADIAL_STD = 0.5  # of k₁; that of each further order is half as large as the one before


@dataclass(frozen=True, slots=True)
class Lens:
    """The lens-like trend with ``order`` radial coefficients; β (p,) = (H: 8, c: 2, log ρ, k₁ … k_n)."""

    order: int

    @property
    def name(self) -> str:
        """The registry's name, such as ``lens:3``."""
        return f"lens:{self.order}"

    @property
    def prior_mean(self) -> Floats:
        """Mean (p,) of β under the prior: zero, i.e. no distortion, the centre at the origin and a round lens."""
        return np.zeros(PARAMETERS + 3 + self.order)

    @property
    def prior_std(self) -> Floats:
        """Standard deviations (p,) of β, smaller for high orders: the series of a lens converges."""
        radial = [RADIAL_STD * 0.5**j for j in range(self.order)]
        return np.concatenate([Homography().prior_std, [CENTRE_STD, CENTRE_STD, LOG_RATIO_STD], radial])

    def start(self, x: Floats, y: Floats) -> Floats:
        """The β (p,) of the least-squares homography from ``x`` to ``y``, both (n, 2), without distortion."""
        return np.concatenate([Homography().start(x, y), np.zeros(3 + self.order)])

    def value(self, beta: Floats, x: Floats) -> Floats:
        """h(x; β) at ``x`` (n, 2): (n, 2)."""
        return apply_homography(matrix(beta[:PARAMETERS]), self._radial(beta, x)[0])

    def input_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂x at ``x`` (n, 2): (n, 2, 2)."""
        p, jacobian, _ = self._radial(beta, x)
        return np.asarray(homography_jacobian(matrix(beta[:PARAMETERS]), p) @ jacobian)

    def parameter_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂β at ``x`` (n, 2): (n, 2, p)."""
        h = matrix(beta[:PARAMETERS])
        p, by_input, by_shape = self._radial(beta, x)
        by_p = homography_jacobian(h, p)
        by_homography = homography_parameter_jacobian(h, p)[:, :, :PARAMETERS]
        return np.concatenate([by_homography, by_p @ np.concatenate([-by_input, by_shape], axis=2)], axis=2)

    def _radial(self, beta: Floats, x: Floats) -> tuple[Floats, Floats, Floats]:
        """The radially moved points p (n, 2), ∂p/∂x (n, 2, 2), ∂p/∂(log ρ, k) (n, 2, 1 + order)."""
        centre, axes, k = beta[8:10], np.exp([-beta[10], beta[10]]), beta[11:]
        d = x - centre
        squares = d**2 * axes
        r2 = squares.sum(axis=1)
        lower = r2[:, None] ** np.arange(self.order)
        powers = lower * r2[:, None]
        gain = 1.0 + powers @ k
        slope = lower @ (k * np.arange(1, self.order + 1))  # d gain / d r²
        gradient = 2.0 * d * axes
        by_input = gain[:, None, None] * np.eye(2) + slope[:, None, None] * d[:, :, None] * gradient[:, None, :]
        by_ratio = d * (slope * (squares[:, 1] - squares[:, 0]))[:, None]
        by_shape = np.concatenate([by_ratio[:, :, None], d[:, :, None] * powers[:, None, :]], axis=2)
        return d * gain[:, None], by_input, by_shape
