"""The squared exponential kernel, the paper's (its equation for k_SE): infinitely smooth functions."""

from __future__ import annotations

import numpy as np

from pinholify.arrays import Floats
from pinholify.gp.kernels.base import Kernel


class SquaredExponential(Kernel):
    """ρ(s) = exp(−s/2)."""

    __slots__ = ()

    def correlation(self, s: Floats) -> Floats:
        """ρ(s)."""
        return np.exp(-0.5 * s)

    def slope(self, s: Floats) -> Floats:
        """dρ/ds."""
        return -0.5 * np.exp(-0.5 * s)
