"""Smooth maps evaluated at every pixel: exactly at a few Chebyshev nodes, expanded by two small matrix products.

A region where the expansion does not converge, or where the map does not exist at some node, is split into four; the
smallest regions are evaluated pixel by pixel (Trefethen, *Approximation Theory and Approximation Practice*, ch. 3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from pinholify.arrays import Bools, Floats
from pinholify.geometry import grid_points

NODES = 24  # along each axis
TAIL = 4  # highest orders from which the error of an expansion is estimated
SMALLEST_REGION = 32  # px; regions of at most this size are evaluated directly

PointMap = Callable[[Floats], Floats]
"""A function of points (n, 2) with values (n, outputs), nan where it is not defined."""


@dataclass(frozen=True, slots=True)
class Region:
    """Pixels ``left`` ≤ x < ``right``, ``top`` ≤ y < ``bottom``."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def small(self) -> bool:
        """Whether direct evaluation is as cheap as evaluation at the nodes."""
        return max(self.right - self.left, self.bottom - self.top) <= SMALLEST_REGION

    def quarters(self) -> list[Region]:
        """The four regions that make up this one."""
        x, y = (self.left + self.right + 1) // 2, (self.top + self.bottom + 1) // 2
        parts = [(self.left, self.top, x, y), (x, self.top, self.right, y)]
        parts += [(self.left, y, x, self.bottom), (x, y, self.right, self.bottom)]
        return [Region(*p) for p in parts if p[0] < p[2] and p[1] < p[3]]

    def pixels(self) -> Floats:
        """All pixels (n, 2), row-major."""
        return grid_points(np.arange(float(self.left), self.right), np.arange(float(self.top), self.bottom))

    def nodes(self) -> Floats:
        """The Chebyshev nodes (NODES², 2), row-major, all of them inside the region."""
        t = nodes()
        x = (self.left + self.right - 1) / 2.0 + t * (self.right - 1 - self.left) / 2.0
        y = (self.top + self.bottom - 1) / 2.0 + t * (self.bottom - 1 - self.top) / 2.0
        return grid_points(x, y)

    def of(self, planes: NDArray[Any]) -> NDArray[Any]:
        """The region (outputs, rows, columns) of ``planes`` (outputs, height, width)."""
        return planes[:, self.top : self.bottom, self.left : self.right]


def _is_finite(values: Floats) -> Bools:
    return np.asarray(np.isfinite(values).all(axis=-1))


def expand(
    function: PointMap,
    size: tuple[int, int],
    *,
    outputs: int = 2,
    tolerance: float = 0.005,
    wanted: Callable[[Floats], Bools] = _is_finite,
    dtype: DTypeLike = np.float32,
) -> NDArray[Any]:
    """``function`` at every pixel of an image of ``size`` (width, height): (outputs, height, width) of ``dtype``.

    ``tolerance`` bounds the expansion's error, in units of the function's values. The result is nan where the function
    is not defined. Regions without a node whose values (…, outputs) are ``wanted`` are skipped, and nan too.
    """
    width, height = size
    out = np.empty((outputs, height, width), dtype=dtype)
    regions = [Region(0, 0, width, height)]
    while regions:
        small = [r for r in regions if r.small]
        large = [r for r in regions if not r.small]
        if small:
            _fill_directly(function, small, out)
        regions = _fill_by_nodes(function, large, out, tolerance, wanted) if large else []
    return out


def _fill_directly(function: PointMap, regions: list[Region], out: NDArray[Any]) -> None:
    pixels = [r.pixels() for r in regions]
    values = np.split(function(np.concatenate(pixels)), np.cumsum([len(p) for p in pixels])[:-1])
    for region, value in zip(regions, values, strict=True):
        part = region.of(out)
        part[...] = value.T.reshape(part.shape)


def _fill_by_nodes(
    function: PointMap,
    regions: list[Region],
    out: NDArray[Any],
    tolerance: float,
    wanted: Callable[[Floats], Bools],
) -> list[Region]:
    """Fill the regions that converge, and return the quarters of those that do not."""
    values = function(np.concatenate([r.nodes() for r in regions])).reshape(len(regions), NODES, NODES, -1)
    with np.errstate(invalid="ignore"):
        coefficients = to_coefficients(values)
    rest: list[Region] = []
    for region, value, coefficient in zip(regions, values, coefficients, strict=True):
        if not wanted(value).any():
            region.of(out)[...] = np.nan
        elif np.isfinite(value).all() and tail(coefficient) <= tolerance:
            _evaluate(coefficient, region.of(out))
        else:
            rest += region.quarters()
    return rest


def tail(coefficient: Floats) -> float:
    """Sum of the magnitudes of the highest orders along either axis: an estimate of what further orders would add."""
    size = np.abs(coefficient)
    return float(max(size[:, -TAIL:].sum(axis=(1, 2)).max(), size[:, :, -TAIL:].sum(axis=(1, 2)).max()))


def _evaluate(coefficient: Floats, part: NDArray[Any]) -> None:
    """The expansion of ``coefficient`` (outputs, NODES, NODES) at every pixel, written into ``part`` in place."""
    _, height, width = part.shape
    rows, columns = chebyshev(height, part.dtype), chebyshev(width, part.dtype)
    for plane, c in zip(part, coefficient.astype(part.dtype), strict=True):
        np.matmul(rows @ c, columns.T, out=plane)


def nodes() -> Floats:
    """The Chebyshev nodes of [−1, 1], (NODES,)."""
    return np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)


def to_coefficients(values: Floats) -> Floats:
    """Chebyshev coefficients (n, outputs, NODES, NODES) of n maps by their ``values`` (n, NODES, NODES, outputs)."""
    order = np.arange(NODES)[:, None]
    matrix = 2.0 / NODES * np.cos(np.pi * order * (np.arange(NODES) + 0.5) / NODES)
    matrix[0] /= 2.0
    return np.asarray(matrix @ np.moveaxis(values, -1, 1) @ matrix.T)


@lru_cache(maxsize=16)
def chebyshev(count: int, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Chebyshev polynomials at ``count`` equally spaced points of [−1, 1]: (count, NODES)."""
    t = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
    values = np.cos(np.arange(NODES) * np.arccos(t)[:, None]).astype(dtype)
    values.flags.writeable = False
    return values
