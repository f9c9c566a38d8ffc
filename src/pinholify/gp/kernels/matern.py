"""Matérn kernels of smoothness 3/2 and 5/2: functions once and twice differentiable (Rasmussen & Williams, 4.17)."""

from __future__ import annotations

import numpy as np

from pinholify.arrays import Floats
from pinholify.gp.kernels.base import Kernel


class Matern32(Kernel):
    """ρ(s) = (1 + r) exp(−r), r = √(3 s)."""

    __slots__ = ()

    def correlation_and_slope(self, s: Floats) -> tuple[Floats, Floats]:
        """ρ(s) and dρ/ds."""
        r = np.sqrt(3.0 * s)
        decay = np.exp(-r)
        return (1.0 + r) * decay, -1.5 * decay


class Matern52(Kernel):
    """ρ(s) = (1 + r + r²/3) exp(−r), r = √(5 s)."""

    __slots__ = ()

    def correlation_and_slope(self, s: Floats) -> tuple[Floats, Floats]:
        """ρ(s) and dρ/ds."""
        r = np.sqrt(5.0 * s)
        decay = np.exp(-r)
        return (1.0 + r + r**2 / 3.0) * decay, -(5.0 / 6.0) * (1.0 + r) * decay
