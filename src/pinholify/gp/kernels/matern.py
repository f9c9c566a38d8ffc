"""Matérn kernels of smoothness 3/2 and 5/2: functions once and twice differentiable (Rasmussen & Williams, 4.17)."""

from __future__ import annotations

import numpy as np

from pinholify.arrays import Floats
from pinholify.gp.kernels.base import Kernel


class Matern32(Kernel):
    """ρ(s) = (1 + r) exp(−r), r = √(3 s)."""

    __slots__ = ()

    def correlation(self, s: Floats) -> Floats:
        """ρ(s)."""
        r = np.sqrt(3.0 * s)
        return (1.0 + r) * np.exp(-r)

    def slope(self, s: Floats) -> Floats:
        """dρ/ds."""
        return -1.5 * np.exp(-np.sqrt(3.0 * s))


class Matern52(Kernel):
    """ρ(s) = (1 + r + r²/3) exp(−r), r = √(5 s)."""

    __slots__ = ()

    def correlation(self, s: Floats) -> Floats:
        """ρ(s)."""
        r = np.sqrt(5.0 * s)
        return (1.0 + r + r**2 / 3.0) * np.exp(-r)

    def slope(self, s: Floats) -> Floats:
        """dρ/ds."""
        r = np.sqrt(5.0 * s)
        return -(5.0 / 6.0) * (1.0 + r) * np.exp(-r)
