"""The interface of trends: smooth, invertible maps of the plane with a few parameters and a weak prior on them.

Inputs and outputs are normalised: both are of order one around the origin.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.geometry import solve_2x2

LONGEST_STEP = 0.3  # of Newton's method, in normalised units: trends are nearly linear over that distance
MAX_COORDINATE = 10.0  # normalised; an iterate farther out has diverged


class Trend(Protocol):
    """A family h(x; β) of maps of the plane with parameters β (p,)."""

    @property
    def name(self) -> str:
        """The name that :func:`trends_named` turns back into this trend."""
        ...

    @property
    def prior_mean(self) -> Floats:
        """Mean of β under the prior, (p,)."""
        ...

    @property
    def prior_std(self) -> Floats:
        """Standard deviations of β under the prior, (p,); the parameters are independent."""
        ...

    def start(self, x: Floats, y: Floats) -> Floats:
        """A first estimate of β (p,) for ``y`` ≈ h(``x``), both (n, 2)."""
        ...

    def value(self, beta: Floats, x: Floats) -> Floats:
        """h(x; β) at ``x`` (n, 2): (n, 2)."""
        ...

    def input_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂x at ``x`` (n, 2): (n, 2, 2)."""
        ...

    def parameter_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂β at ``x`` (n, 2): (n, 2, p)."""
        ...


def inverse(trend: Trend, beta: Floats, y: Floats, start: Floats, iterations: int = 50) -> tuple[Floats, Bools]:
    """The x (n, 2) with h(x; β) = ``y`` (n, 2) near ``start`` (n, 2), by Newton's method, and which (n,) converged."""
    x = np.array(start)
    tolerance = 1e-12 * max(float(np.abs(y).max(initial=0.0)), 1.0)
    reached = np.zeros(len(x), dtype=bool)
    active = np.arange(len(x))
    for _ in range(iterations):
        with np.errstate(all="ignore"):
            error = y[active] - trend.value(beta, x[active])
            reached[active] = np.abs(error).max(axis=1) < tolerance
            going = ~reached[active] & (np.abs(x[active]).max(axis=1) < MAX_COORDINATE)
            active, error = active[going], error[going]
            if not len(active):
                break
            step = solve_2x2(trend.input_jacobian(beta, x[active]), error)
            length = np.linalg.norm(step, axis=1, keepdims=True)
            x[active] += np.nan_to_num(step * np.minimum(1.0, LONGEST_STEP / length))
    return x, reached
