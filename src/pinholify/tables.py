"""A smooth map of the image kept as a table of cells: tens of millions of points a second.

Each cell holds the biquadratic polynomial through nine exact values (Abramowitz & Stegun, 25.2.11, along both axes);
neighbours share the values on their edge, so the whole is continuous. What a table cannot hold to its tolerance, and
what lies outside the image, is asked of the map itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pinholify.arrays import Floats

FIRST_CELLS, MOST_CELLS = 16, 256
"""Cells along the longer side, at first and at most."""

ENOUGH = 0.995
"""Share of the cells within the tolerance at which a finer table is not tried."""

BLOCK = 16384
"""Points looked up at a time: what this many need stays in the processor's cache."""

WORST = 0.5 - 0.5 / np.sqrt(3.0)
"""Where in a cell a quadratic's error is largest."""

MONOMIALS = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [2.0, -4.0, 2.0]])
"""Values at 0, ½ and 1 → coefficients of 1, x and x²."""

PointMap = Callable[[Floats], Floats]
"""(n, 2) px → (n, 2), nan where there is no answer."""


@dataclass(frozen=True, slots=True, eq=False)
class PointTable:
    """``exact`` over an image of ``image_size`` (width, height) px, tabulated; call it with pixels (…, 2).

    ``cells`` (rows, columns, 18) are each cell's coefficients, both answers' for 1, x, x², y, xy, x²y, y², xy², x²y²;
    nan where ``exact`` is to be asked.
    """

    exact: PointMap
    image_size: tuple[int, int]
    cells: Floats

    def __call__(self, src: ArrayLike) -> Floats:
        """What ``exact`` says of the pixels ``src`` (…, 2), in their shape, within the table's tolerance."""
        given = np.asarray(src, dtype=np.float64)
        uv = given.reshape(-1, 2)
        out = np.empty_like(uv)
        for start in range(0, len(uv), BLOCK):
            out[start : start + BLOCK] = self._looked_up(uv[start : start + BLOCK])
        missing = np.isnan(out[:, 0])
        if missing.any():
            out[missing] = self.exact(uv[missing])
        return out.reshape(given.shape)

    def _looked_up(self, uv: Floats) -> Floats:
        rows, columns, _ = self.cells.shape
        width, height = self.image_size
        x, y = (uv[:, 0] + 0.5) * (columns / width), (uv[:, 1] + 0.5) * (rows / height)
        inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
        x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
        column, row = x.astype(np.int64), y.astype(np.int64)
        x, y = x - column, y - row
        c = self.cells.reshape(-1, 18).take(row * columns + column, axis=0).T
        bottom, middle, top = (c[i : i + 2] + x * (c[i + 2 : i + 4] + x * c[i + 4 : i + 6]) for i in (0, 6, 12))
        found = bottom + y * (middle + y * top)
        found[:, ~inside] = np.nan
        return np.asarray(found.T)


def point_table(exact: PointMap, image_size: tuple[int, int], *, tolerance: float = 1e-3) -> PointTable:
    """A table of ``exact``, right to ``tolerance`` px of the image: cells are halved until nearly all are.

    An error of the answer counts as the shift of the pixel that would cause it. What is left beyond the tolerance is
    not tabulated.
    """
    count = FIRST_CELLS
    while True:
        table = _table(exact, image_size, count)
        error = _cell_errors(table)
        known = np.isfinite(error)
        good = known & (error <= tolerance)
        if good.sum() >= ENOUGH * known.sum() or count >= MOST_CELLS:
            return PointTable(exact, image_size, np.where(good[:, :, None], table.cells, np.nan))
        count *= 2


def _table(exact: PointMap, image_size: tuple[int, int], count: int) -> PointTable:
    """A table with ``count`` cells along the longer side of the image, whatever its error."""
    columns, rows = (max(1, round(count * n / max(image_size))) for n in image_size)
    x, y = (np.linspace(-0.5, n - 0.5, 2 * m + 1) for n, m in zip(image_size, (columns, rows), strict=True))
    values = exact(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(len(y), len(x), 2)
    nodes = np.lib.stride_tricks.sliding_window_view(values, (3, 3), axis=(0, 1))[::2, ::2]
    cells = np.einsum("qj,pi,rckji->rcqpk", MONOMIALS, MONOMIALS, nodes, optimize=True)
    return PointTable(exact, image_size, cells.reshape(rows, columns, 18))


def _cell_errors(table: PointTable) -> Floats:
    """Each cell's error (rows, columns) in px of the image, at the place where it should be largest."""
    rows, columns, _ = table.cells.shape
    side = np.array(table.image_size) / (columns, rows)
    index = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    uv = (index + np.array([WORST, 1.0 - WORST])) * side - 0.5
    found = table._looked_up(uv)
    slopes = np.stack([table._looked_up(uv + e) - found for e in np.eye(2) * 1e-3], axis=-1) / 1e-3
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.sqrt(np.abs(np.linalg.det(slopes)))  # of the answer a px of the image
        error = np.linalg.norm(found - table.exact(uv), axis=1) / scale
    return np.asarray(error.reshape(rows, columns))
