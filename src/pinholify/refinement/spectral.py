"""Spectral densities of the kernels in two dimensions (Rasmussen & Williams, 4.2.1): prior variances of the weights."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinholify.arrays import Floats
from pinholify.errors import InputError
from pinholify.gp.regression import LOG_2PI

LogDensity = Callable[[Floats, Floats], tuple[Floats, Floats]]
"""(log parameters (p,): σ then length scales, frequencies (M, 2)) → log S (M,) and its gradient (M, p)."""


def squared_exponential(parameters: Floats, frequencies: Floats) -> tuple[Floats, Floats]:
    """Log density of S = σ² 2π l_u l_v exp(−½ Σ l² ω²), for one or two length scales, and its gradient."""
    scales = np.exp(parameters[1:])
    squares = (frequencies * scales) ** 2
    shared = 2.0 / len(scales)  # how many dimensions share a length scale
    value = 2.0 * parameters[0] + LOG_2PI + shared * parameters[1:].sum() - 0.5 * squares.sum(axis=1)
    by_scale = shared - (squares if len(scales) == 2 else squares.sum(axis=1, keepdims=True))
    return value, np.column_stack([np.full(len(value), 2.0), by_scale])


def matern(smoothness: float) -> LogDensity:
    """The log density function of S = σ² 4πν (2ν)^ν l^(−2ν) (2ν/l² + ω²)^(−ν−1), ν = ``smoothness``."""

    def log_density(parameters: Floats, frequencies: Floats) -> tuple[Floats, Floats]:
        squares = (frequencies**2).sum(axis=1) * np.exp(2.0 * parameters[1])
        spread = 2.0 * smoothness + squares  # (2ν/l² + ω²) l²
        constant = np.log(4.0 * np.pi * smoothness) + smoothness * np.log(2.0 * smoothness)
        value = 2.0 * parameters[0] + constant + 2.0 * parameters[1] - (smoothness + 1.0) * np.log(spread)
        by_scale = 2.0 - 2.0 * (smoothness + 1.0) * squares / spread
        return value, np.column_stack([np.full(len(value), 2.0), by_scale])

    return log_density


DENSITIES: dict[str, tuple[LogDensity, int]] = {
    "se": (squared_exponential, 1),
    "ard-se": (squared_exponential, 2),
    "matern32": (matern(1.5), 1),
    "matern52": (matern(2.5), 1),
}
"""Kernel name → its log spectral density and its number of length scales."""


def density_named(name: str) -> tuple[LogDensity, int]:
    """The log density of the kernel ``name`` and its number of length scales; raises InputError for unknown names."""
    if name not in DENSITIES:
        raise InputError(f"the joint refinement has no kernel '{name}': choose one of {', '.join(DENSITIES)}")
    return DENSITIES[name]
