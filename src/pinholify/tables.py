"""A smooth map of the image kept as a table of cells: tens of millions of points a second.

Each cell holds the biquadratic polynomial through nine values (Abramowitz & Stegun, 25.2.11, along both axes);
neighbours share the values on their edge, so the whole is continuous. The values come from a Chebyshev expansion, so
the map itself is asked for few of them. What a table cannot hold to its tolerance, and what lies outside the image, is
asked of the map itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pinholify.arrays import Floats
from pinholify.expansion import expand
from pinholify.gp.trends.base import solve_2x2

FIRST_CELLS, MOST_CELLS = 32, 512
"""Cells along the longer side, at first and at most."""

ENOUGH = 0.995
"""Share of the cells within the tolerance at which a finer table is not tried."""

MOST = 0.9
"""Share of the cells that tell how much finer the next table is."""

EXPANSION = 0.1
"""Share of the tolerance that is left to the expansion."""

BLOCK = 8192
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

    ``cells`` (rows, columns, 9) are each cell's coefficients for 1, x, x², y, xy, x²y, y², xy², x²y², the two answers
    being real and imaginary part; nan where ``exact`` is to be asked.
    """

    exact: PointMap
    image_size: tuple[int, int]
    cells: NDArray[np.complex128]

    def __call__(self, src: ArrayLike) -> Floats:
        """What ``exact`` says of the pixels ``src`` (…, 2), in their shape, within the table's tolerance."""
        given = np.asarray(src, dtype=np.float64)
        uv = given.reshape(-1, 2)
        out = np.empty(uv.shape)
        for start in range(0, len(uv), BLOCK):
            self._look_up(uv[start : start + BLOCK], out[start : start + BLOCK])
        missing = np.isnan(out[:, 0])
        if missing.any():
            out[missing] = self.exact(uv[missing])
        return out.reshape(given.shape)

    def _look_up(self, uv: Floats, out: Floats) -> None:
        """The table's answer to ``uv`` (n, 2), written into ``out`` (n, 2); nan outside the image."""
        rows, columns, _ = self.cells.shape
        width, height = self.image_size
        x, y = (uv[:, 0] + 0.5) * (columns / width), (uv[:, 1] + 0.5) * (rows / height)
        outside = ~((x >= 0) & (x < columns) & (y >= 0) & (y < rows))
        x[outside] = y[outside] = 0.0
        column, row = x.astype(np.intp), y.astype(np.intp)
        x -= column
        y -= row
        c = self.cells.reshape(-1, 9).take(row * columns + column, axis=0, mode="clip")
        # As complex numbers both answers are worked out in one go.
        found = _quadratic([_quadratic([c[:, i + k] for k in range(3)], x) for i in (0, 3, 6)], y)
        found[outside] = np.nan
        out[:, 0], out[:, 1] = found.real, found.imag


def _quadratic(coefficients: list[NDArray[np.complex128]], x: Floats) -> NDArray[np.complex128]:
    """c₀ + c₁x + c₂x² of three arrays (n,)."""
    value = coefficients[2] * x
    value += coefficients[1]
    value *= x
    value += coefficients[0]
    return value


def point_table(
    exact: PointMap, image_size: tuple[int, int], *, tolerance: float = 1e-3, of_answer: bool = False
) -> PointTable:
    """A table of ``exact``, right to ``tolerance`` px of the image: cells are made smaller until nearly all are.

    An error of the answer counts as the shift of the pixel that would cause it, or, if ``of_answer``, as it is. What is
    left beyond the tolerance is not tabulated.
    """
    count = FIRST_CELLS
    fine = EXPANSION * tolerance * (1.0 if of_answer else _px(exact, image_size))
    while True:
        table = _table(exact, image_size, count, fine)
        error = _cell_errors(table, fine, of_answer)
        known = np.isfinite(error)
        good = known & (error <= tolerance)
        if good.sum() >= ENOUGH * known.sum() or count >= MOST_CELLS:
            return PointTable(exact, image_size, np.where(good[:, :, None], table.cells, np.nan))
        # Of half the size they are eight times as good, but for a few that never are: towards 90° from the axis.
        needed = np.log(np.quantile(error[known], MOST) / tolerance) / np.log(8.0)
        count = min(count * 2 ** max(1, int(np.ceil(needed))), MOST_CELLS)


def _px(exact: PointMap, image_size: tuple[int, int]) -> float:
    """The smallest change of the answer that a px of the image makes, over the image, to see when an error is small."""
    u, v = (np.linspace(0.0, n - 1.0, 9) for n in image_size)
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    ends = [exact(uv + e) - exact(uv - e) for e in np.eye(2) / 2.0]
    with np.errstate(invalid="ignore"):
        area = np.abs(np.linalg.det(np.stack(ends, axis=-1)))
    return float(np.sqrt(np.nanmin(area))) if np.isfinite(area).any() else 1.0


def _table(exact: PointMap, image_size: tuple[int, int], count: int, tolerance: float) -> PointTable:
    """A table with ``count`` cells along the longer side of the image, whatever its error."""
    columns, rows = (max(1, round(count * n / max(image_size))) for n in image_size)
    step = np.array(image_size) / (2.0 * columns, 2.0 * rows)
    counts = (2 * columns + 1, 2 * rows + 1)
    first, second = expand(lambda index: exact(index * step - 0.5), counts, tolerance=tolerance, dtype=np.float64)
    nodes = np.lib.stride_tricks.sliding_window_view(first + 1j * second, (3, 3))[::2, ::2]
    cells = MONOMIALS @ nodes @ MONOMIALS.T
    return PointTable(exact, image_size, cells.reshape(rows, columns, 9))


def _cell_errors(table: PointTable, tolerance: float, of_answer: bool) -> Floats:
    """Each cell's error (rows, columns) at the place where it should be largest, px of the image or of the answer."""
    rows, columns, _ = table.cells.shape
    side = np.array(table.image_size) / (columns, rows)
    offset = np.array([WORST, 1.0 - WORST])

    def place(index: Floats) -> Floats:
        return np.asarray((index + offset) * side - 0.5)

    truth = expand(lambda index: table.exact(place(index)), (columns, rows), tolerance=tolerance, dtype=np.float64)
    uv = place(np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(np.float64))
    found, right, down = (np.empty(uv.shape) for _ in range(3))
    for out, shift in ((found, [0.0, 0.0]), (right, [1e-3, 0.0]), (down, [0.0, 1e-3])):
        table._look_up(uv + shift, out)
    error = found - truth.reshape(2, -1).T
    if not of_answer:
        slopes = np.stack([right - found, down - found], axis=-1) / 1e-3
        with np.errstate(invalid="ignore", divide="ignore"):
            error = solve_2x2(slopes, error)
    return np.asarray(np.linalg.norm(error, axis=1).reshape(rows, columns))
