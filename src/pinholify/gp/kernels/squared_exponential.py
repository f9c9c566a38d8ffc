"""The squared exponential kernel, which the paper uses (its equation for k_SE): infinitely smooth functions."""

from __future__ import annotations

import numpy as np

from pinholify.arrays import Floats
from pinholify.gp.kernels.base import Kernel


class SquaredExponential(Kernel):
    """ρ(s) = exp(−s/2)."""

    __slots__ = ()

    def correlation_and_slope(self, s: Floats) -> tuple[Floats, Floats]:
        """ρ(s) and dρ/ds."""
        correlation = np.exp(-0.5 * s)
        return correlation, -0.5 * correlation
