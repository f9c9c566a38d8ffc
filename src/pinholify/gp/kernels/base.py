"""The base of all covariance functions: they are stationary, so a kernel is one function ρ of a scaled distance."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from pinholify.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Kernel(ABC):
    """A stationary kernel σ² ρ(s), s = Σ_d ((x_d − x'_d)/l_d)², over inputs of any dimension.

    ``std`` is σ. ``length_scale`` is l: a (1,) array for an isotropic kernel, (d,) for one scale per dimension
    (automatic relevance determination). A subclass supplies :meth:`correlation_and_slope`; one with a further
    shape parameter extends :attr:`log_parameters`, :meth:`with_log_parameters` and :meth:`correlation_gradients`.
    """

    std: float = 1.0
    length_scale: Floats = field(default_factory=lambda: np.ones(1))

    @abstractmethod
    def correlation_and_slope(self, s: Floats) -> tuple[Floats, Floats]:
        """ρ(s) and dρ/ds, elementwise for any shape of ``s``; ρ(0) = 1."""

    @property
    def log_parameters(self) -> Floats:
        """Logarithms of all parameters: σ, then the length scales, then those of the subclass."""
        return np.asarray(np.log(np.concatenate([[self.std], self.length_scale])))

    def with_log_parameters(self, log_parameters: Floats) -> Self:
        """The same kernel with other parameters, in the order of :attr:`log_parameters`."""
        values = np.exp(log_parameters)
        return replace(self, std=float(values[0]), length_scale=values[1 : 1 + len(self.length_scale)])

    def squared_differences(self, x: Floats, x2: Floats) -> Floats:
        """Unscaled squared differences of ``x`` (n, d) and ``x2`` (m, d) per length scale: (scales, n, m)."""
        squares = np.stack([np.subtract.outer(a, b) ** 2 for a, b in zip(x.T, x2.T, strict=True)])
        return squares.sum(axis=0, keepdims=True) if len(self.length_scale) == 1 else squares

    def scaled(self, squared_differences: Floats) -> Floats:
        """s (n, m) from :meth:`squared_differences`."""
        return np.asarray(np.tensordot(self.length_scale**-2.0, squared_differences, axes=1))

    def covariance(self, x: Floats, x2: Floats) -> Floats:
        """k(x, x2), (n, m), for points ``x`` (n, d) and ``x2`` (m, d)."""
        return self.covariance_and_slope(x, x2)[0]

    def covariance_and_slope(self, x: Floats, x2: Floats) -> tuple[Floats, Floats]:
        """k(x, x2) and the D with ∂k/∂x_d = D (x_d − x2_d)/l_d²: (n, m) each."""
        a, b = x / self.length_scale, x2 / self.length_scale
        s = (-2.0 * a) @ b.T
        s += (a**2).sum(axis=1)[:, None]
        s += (b**2).sum(axis=1)
        correlation, slope = self.correlation_and_slope(np.maximum(s, 0.0, out=s))
        return self.std**2 * correlation, 2.0 * self.std**2 * slope

    def covariance_and_gradients(self, squared_differences: Floats) -> tuple[Floats, list[Floats]]:
        """k at :meth:`squared_differences`, (n, m), and ∂k/∂log parameter, each (n, m), in parameter order."""
        s = self.scaled(squared_differences)
        covariance, slope = (self.std**2 * part for part in self.correlation_and_slope(s))
        by_scale = [
            slope * d2 * (-2.0 / scale**2) for d2, scale in zip(squared_differences, self.length_scale, strict=True)
        ]
        return covariance, [2.0 * covariance, *by_scale, *(self.std**2 * g for g in self.correlation_gradients(s))]

    def correlation_gradients(self, s: Floats) -> list[Floats]:
        """∂ρ/∂log p at ``s`` (n, m) for each parameter p that the subclass adds: (n, m) each."""
        return []
