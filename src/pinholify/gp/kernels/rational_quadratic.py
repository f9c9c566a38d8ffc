"""The rational quadratic kernel: squared exponentials of many length scales, mixed (Rasmussen & Williams, 4.19)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pinholify.arrays import Floats
from pinholify.gp.kernels.base import Kernel


@dataclass(frozen=True, slots=True, eq=False)
class RationalQuadratic(Kernel):
    """ρ(s) = (1 + s/(2α))^(−α); α → ∞ is the squared exponential."""

    alpha: float = 1.0

    def correlation_and_slope(self, s: Floats) -> tuple[Floats, Floats]:
        """ρ(s) and dρ/ds."""
        base = 1.0 + s / (2.0 * self.alpha)
        correlation = base**-self.alpha
        return correlation, -0.5 * correlation / base

    @property
    def log_parameters(self) -> Floats:
        """Logarithms of σ, the length scales and α."""
        return np.asarray(np.log(np.concatenate([[self.std], self.length_scale, [self.alpha]])))

    def with_log_parameters(self, log_parameters: Floats) -> Self:
        """The same kernel with other parameters, in the order of :attr:`log_parameters`."""
        values = np.exp(log_parameters)
        return replace(self, std=float(values[0]), length_scale=values[1:-1], alpha=float(values[-1]))

    def correlation_gradients(self, s: Floats) -> list[Floats]:
        """∂ρ/∂log α at ``s`` (n, m): one array (n, m)."""
        base = 1.0 + s / (2.0 * self.alpha)
        return [self.correlation_and_slope(s)[0] * (s / (2.0 * base) - self.alpha * np.log(base))]
