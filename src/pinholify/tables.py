"""A smooth map of the image as a table of cells: tens of millions of points per second.

Each cell holds the biquadratic polynomial through nine values (Abramowitz & Stegun, 25.2.11, along both axes). Where
the map bends more, cells are smaller: the image is divided into tiles, and each tile into as many cells as it needs.
The values come from Chebyshev expansions of parts of the image, so the map itself is evaluated rarely. Where the table
does not reach its tolerance, and outside the image, the map itself is evaluated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pinholify.arrays import Bools, Floats, Ints
from pinholify.expansion import NODES, PointMap, chebyshev, nodes, tail, to_coefficients
from pinholify.geometry import grid_points

HALVINGS = 6
"""How often the image is halved along both axes to give a tile."""

TILES = 1 << HALVINGS
"""Tiles along each side of the image."""

MOST_SPLITS, MOST_CELLS = 16, 512
"""Most cells along a side of a tile, and of a part of the image that one expansion covers."""

TAIL_SHARE = 0.5
"""Share of the tolerance that the highest orders of an expansion may reach; its error is a tenth of them or less."""

AT_ONCE = 8
"""Expansions made at a time."""

BLOCK = 8192
"""Points looked up at a time: their data stay in the processor's cache."""

MONOMIALS = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [2.0, -4.0, 2.0]])
"""Values at 0, ½ and 1 → coefficients of 1, x and x²."""

QUARTER = np.array([1.0, 1.0 / 4.0, 1.0 / 16.0]) @ MONOMIALS
"""Values at 0, ½ and 1 → value of the quadratic at ¼."""

WORST_ERROR_RATIO = 16.0 / (9.0 * np.sqrt(3.0))
"""Largest error of a quadratic, at ½ − ½/√3, ÷ its error at ¼."""

HALF_NODES = grid_points(nodes(), nodes()) / 2.0
"""Chebyshev nodes of a square of side 1 around the origin, row by row."""

Complexes = NDArray[np.complex128]
"""A map's two values as one complex number, so that both are computed at once."""


@dataclass(frozen=True, slots=True, eq=False)
class PointTable:
    """The map ``exact`` (n, 2) → (n, 2), tabulated over an image of ``image_size`` (width, height) px.

    ``splits`` (TILES²,) is the number of cells along each side of each tile, row by row, ``first`` (TILES²,) the
    position of the tile's first cell. ``cells`` (n, 9) are each cell's coefficients of 1, x, x², y, xy, x²y, y², xy²,
    x²y²; nan where ``exact`` has to be evaluated.
    """

    exact: PointMap
    image_size: tuple[int, int]
    splits: Ints
    first: Ints
    cells: Complexes

    def __call__(self, src: ArrayLike) -> Floats:
        """``exact`` of the pixels ``src`` (…, 2), in their shape, within the table's tolerance."""
        given = np.asarray(src, dtype=np.float64)
        uv = given.reshape(-1, 2)
        found = np.empty(len(uv), dtype=np.complex128)
        for start in range(0, len(uv), BLOCK):
            found[start : start + BLOCK] = self._look_up(uv[start : start + BLOCK])
        out = found.view(np.float64).reshape(uv.shape)
        missing = np.isnan(out[:, 0])
        if missing.any():
            out[missing] = self.exact(uv[missing])
        return out.reshape(given.shape)

    def _look_up(self, uv: Floats) -> Complexes:
        """The table's values (n,) at ``uv`` (n, 2); nan outside the image."""
        x, y = (uv[:, k] * (TILES / n) + 0.5 * TILES / n for k, n in enumerate(self.image_size))
        outside = ~((x >= 0) & (x < TILES) & (y >= 0) & (y < TILES))
        x[outside] = y[outside] = 0.0
        column, row = _whole(x), _whole(y)
        tile = row * TILES + column
        splits = self.splits.take(tile)
        x *= splits
        y *= splits
        column, row = _whole(x), _whole(y)
        c = self.cells.take(self.first.take(tile) + row * splits + column, axis=0, mode="clip")
        found = _quadratic([_quadratic([c[:, i + k] for k in range(3)], x) for i in (0, 3, 6)], y)
        found[outside] = np.nan
        return found


def _whole(x: Floats) -> Ints:
    """The integer parts of ``x`` (n,), in which the fractions remain."""
    whole = x.astype(np.intp)
    x -= whole
    return whole


def _quadratic(coefficients: list[Complexes], x: Floats) -> Complexes:
    """c₀ + c₁x + c₂x² of three arrays (n,)."""
    value = coefficients[2] * x
    value += coefficients[1]
    value *= x
    value += coefficients[0]
    return value


def point_table(
    exact: PointMap, image_size: tuple[int, int], *, tolerance: float = 1e-3, of_answer: bool = False
) -> PointTable:
    """A table of ``exact`` with an error of at most ``tolerance`` px of the image, with cells as large as possible.

    The error of a value is converted to the shift of the pixel that would cause it, or used directly if ``of_answer``.
    Where the tolerance is not reached, the table is empty.
    """
    splits, first = np.ones((TILES, TILES), np.intp), np.zeros((TILES, TILES), np.intp)
    parts, count = [np.full((1, 9), np.nan + 0j)], 1
    for square, coefficients in _expansions(exact, np.array(image_size), tolerance, of_answer):
        for each, tiles, cells in _enough_cells(coefficients, square, tolerance, of_answer):
            splits[square.place][tiles] = each
            first[square.place][tiles] = count + each**2 * np.arange(tiles.sum())
            parts.append(cells)
            count += len(cells)
    return PointTable(exact, image_size, splits.ravel(), first.ravel(), np.concatenate(parts))


# --- expansions --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Square:
    """The part of the image in ``row`` and ``column`` of those made by halving it ``halvings`` times along both axes.

    ``side`` (width, height) is in px.
    """

    halvings: int
    row: int
    column: int
    side: tuple[float, float]

    @property
    def tiles(self) -> int:
        """Tiles along each side."""
        return TILES >> self.halvings

    @property
    def place(self) -> tuple[slice, slice]:
        """Rows and columns of its tiles."""
        n = self.tiles
        return slice(self.row * n, (self.row + 1) * n), slice(self.column * n, (self.column + 1) * n)

    def nodes(self) -> Floats:
        """Pixels (NODES², 2) of the Chebyshev nodes, row by row."""
        middle = np.array([self.column + 0.5, self.row + 0.5])
        return np.asarray((middle + HALF_NODES) * self.side - 0.5)

    def quarters(self) -> list[_Square]:
        """The four squares that make up this one; none if it is a single tile."""
        if not self.halvings < HALVINGS:
            return []
        half = self.side[0] / 2.0, self.side[1] / 2.0
        return [
            _Square(self.halvings + 1, 2 * self.row + down, 2 * self.column + right, half)
            for down in (0, 1)
            for right in (0, 1)
        ]


def _expansions(
    exact: PointMap, image_size: Floats, tolerance: float, of_answer: bool
) -> Iterator[tuple[_Square, Complexes]]:
    """The squares where an expansion converges, and its coefficients (NODES, NODES)."""
    squares = [_Square(0, 0, 0, (float(image_size[0]), float(image_size[1])))]
    while squares:
        some, squares = squares[:AT_ONCE], squares[AT_ONCE:]
        values = exact(np.concatenate([square.nodes() for square in some]))
        with np.errstate(invalid="ignore"):
            expanded = to_coefficients(values.reshape(len(some), NODES, NODES, 2))
        for square, coefficients in zip(some, expanded, strict=True):
            px = 1.0 if of_answer else _px(coefficients, square)
            if tail(coefficients) <= TAIL_SHARE * tolerance * px:  # not if any value is nan
                yield square, coefficients[0] + 1j * coefficients[1]
            else:
                squares += square.quarters()


def _px(coefficients: Floats, square: _Square) -> float:
    """Approximate change of the map's value per px of the image in ``square``."""
    (u_y, v_y), (u_x, v_x) = coefficients[:, 1, 0], coefficients[:, 0, 1]
    return float(2.0 * np.sqrt(np.abs(u_x * v_y - u_y * v_x) / (square.side[0] * square.side[1])))


# --- cells -------------------------------------------------------------------------------------------------------


def _enough_cells(
    coefficients: Complexes, square: _Square, tolerance: float, of_answer: bool
) -> Iterator[tuple[int, Bools, Complexes]]:
    """The largest cells that represent an expansion within the tolerance; nan where none do.

    Yields a number of cells along a side, the tiles of ``square`` (n, n) that are split so, and their cells (m, 9).
    """
    n, each = square.tiles, 1
    left = np.ones((n, n), dtype=bool)
    while left.any():
        along = _along(n * each)
        error = _cell_errors(coefficients, along, None if of_answer else square.side)
        good = (WORST_ERROR_RATIO * error <= tolerance).reshape(n, each, n, each).swapaxes(1, 2)
        final = 2 * each > MOST_SPLITS or 2 * n * each > MOST_CELLS
        tiles = left & (final | good.all(axis=(2, 3)))
        if tiles.any():
            row, column = np.nonzero(tiles)
            monomials = along.monomials.reshape(n, 3 * each, NODES)
            cells = (monomials @ coefficients)[row] @ monomials.swapaxes(1, 2)[column]
            cells = cells.reshape(-1, each, 3, each, 3).swapaxes(2, 3)
            cells[~good[tiles]] = np.nan
            yield each, tiles, cells.reshape(-1, 9)
        left &= ~tiles
        each *= 2


def _cell_errors(coefficients: Complexes, along: _Along, side: tuple[float, float] | None) -> Floats:
    """Each cell's error (n, n): in px of the image if ``side`` is the square's (width, height), else that of the value.

    A quadratic's error is largest near a quarter of the cell, and of opposite sign near three quarters: the errors
    along both axes add up at one of two points.
    """
    n = len(along.half)
    error = along.fitted @ coefficients @ along.fitted[:n].T - along.truth @ coefficients @ along.truth[:n].T
    if side is None:
        return np.asarray(np.abs(error).reshape(2, n, n).max(axis=0))
    right, below = (a @ coefficients @ b.T for a, b in ((along.half, along.rise), (along.rise, along.half)))
    u, v = _components(error.reshape(2, n, n), right, below)
    return np.asarray(np.hypot(u * (side[0] / n), v * (side[1] / n)).max(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class _Along:
    """Matrices (…, NODES) that evaluate expansions along a side of a square of n cells.

    ``monomials`` (n, 3, …) gives each cell's coefficients of 1, x and x²; ``truth`` (2n, …) the values at a quarter of
    each cell, then at three quarters, and ``fitted`` those of the quadratics there; ``half`` (n, …) the values at the
    middle, and ``rise`` (n, …) the change from end to end.
    """

    monomials: Complexes
    truth: Complexes
    fitted: Complexes
    half: Complexes
    rise: Complexes


@lru_cache(maxsize=16)
def _along(count: int) -> _Along:
    values = chebyshev(4 * count + 1).astype(np.complex128)
    nodes = np.stack([values[:-4:4], values[2::4], values[4::4]])
    return _Along(
        MONOMIALS @ nodes.swapaxes(0, 1),
        np.concatenate([values[1::4], values[3::4]]),
        np.tensordot([QUARTER, QUARTER[::-1]], nodes, axes=1).reshape(-1, NODES),
        values[2::4],
        values[4::4] - values[:-4:4],
    )


def _components(value: Complexes, first: Complexes, second: Complexes) -> tuple[Floats, Floats]:
    """The real a and b with a ``first`` + b ``second`` = ``value``, by Cramer's rule; not finite where none exist."""
    with np.errstate(invalid="ignore", divide="ignore"):
        area = (first.conj() * second).imag
        return (value.conj() * second).imag / area, (first.conj() * value).imag / area
