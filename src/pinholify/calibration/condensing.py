"""Condensing dense boards: a few accurate points in place of many, so that dense correspondences are quick to solve.

A board of thousands of points samples a smooth map far more densely than the map needs, and an exact Gaussian process
costs n³ for n points. The lattice is therefore cut into blocks of k × k points, k odd, and each block is represented by
its middle point: the mean of the block's points, corrected for what the image's curvature adds to that mean. The
curvature is that of a quadratic through the block and one more point on each side. At k = 3 the result keeps 64 % of
the points' information, is unbiased up to the third order, and its noise hardly depends on the neighbours'.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.board import Board, lattice, size
from pinholify.corners import Corners, CornerSet

MIN_QUADRATIC_POINTS = 7  # a quadratic has six coefficients; one point to spare
MAX_RELATIVE_VARIANCE = 1.0  # of a typical point: a block that yields no better point, at a board's edge, is left out
RANK_TOLERANCE = 1e-6


def condensed(corners: CornerSet, most: int) -> CornerSet:
    """``corners`` with at most about ``most`` points in total, by blocks of the same size in all views.

    A set that has no more than that is returned unchanged.
    """
    side = block_side(sum(len(view) for view in corners.found), most)
    return corners.with_views(condensed_view(view, corners.board, side) for view in corners.views)


def block_side(total: int, most: int) -> int:
    """The smallest odd block side, in points, that leaves at most about ``most`` of ``total`` points."""
    return int(np.ceil(np.sqrt(total / most))) // 2 * 2 + 1 if total > most else 1


def condensed_view(view: Corners, board: Board, side: int) -> Corners:
    """``view`` with one point per block of ``side`` × ``side`` points, ``side`` odd: the block's middle, weighted."""
    if side == 1 or not view.found:
        return view
    reach = side // 2
    points = _Points(view, board, reach + 1)
    around, block = points.sums(reach + 1, reach, side), points.sums(reach, reach, side)
    fit = around.solved()
    mean = block.gram[..., 0, :] / np.maximum(block.gram[..., :1, 0], 1e-300)
    unbent = np.eye(6)[0] - mean
    uv = block.right[..., 0, :] / np.maximum(block.gram[..., :1, 0], 1e-300) + _product(unbent, fit.coefficients)
    variance = 1.0 / np.maximum(block.gram[..., 0, 0], 1e-300) + fit.inverse[..., 0, 0] - (
        _product(mean, fit.inverse) * mean
    ).sum(axis=-1)
    good = fit.known & (variance * np.median(view.weights) ** 2 < MAX_RELATIVE_VARIANCE)
    if 2 * good.sum() * side**2 < len(view):  # points scattered over the lattice leave the blocks too few: subsample
        return view.select(np.arange(len(view)) % side**2 == 0)
    ids = np.arange(size(board)).reshape(board.rows, board.columns)[reach::side, reach::side]
    return replace(view, ids=ids[good], uv=uv[good], weights=variance[good] ** -0.5)


def predicted_by_neighbours(view: Corners, board: Board, reach: int) -> tuple[Floats, Floats]:
    """Each point of ``view`` as predicted by a quadratic through its neighbours: pixels (n, 2) and variances (n,).

    Neighbours are the other points up to ``reach`` rows and columns away. The variance is relative to that of a point
    of weight 1. Where the neighbours do not determine the quadratic, the pixel is nan and the variance inf.
    """
    fit = _Points(view, board, reach).sums(reach, 0, 1, without_middle=True).solved()
    row, column = np.divmod(view.ids, board.columns)
    known = fit.known[row, column]
    uv = np.where(known[:, None], fit.coefficients[row, column, 0], np.nan)
    return uv, np.where(known, fit.inverse[row, column, 0, 0], np.inf)


def _product(vector: Floats, matrix: Floats) -> Floats:
    """Row vectors (…, i) times matrices (…, i, j): (…, j)."""
    return np.asarray((vector[..., None, :] @ matrix)[..., 0, :])


@dataclass(frozen=True, slots=True, eq=False)
class _Quadratics:
    """Quadratics around the middles, one per entry of the leading dimensions.

    ``coefficients`` (…, 6, 2) belong to the monomials, ``inverse`` (…, 6, 6) is their covariance, and ``known`` (…)
    marks those that the points determine.
    """

    coefficients: Floats
    inverse: Floats
    known: Bools


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Sums over the points around each middle, with m the monomials of a point's place relative to the middle.

    ``gram`` is Σ w² m mᵀ (…, 6, 6), ``right`` Σ w² m uvᵀ (…, 6, 2), ``count`` (…) the number of points.
    """

    gram: Floats
    right: Floats
    count: Floats

    def solved(self) -> _Quadratics:
        """The least-squares quadratics; those that the points do not determine are finite placeholders."""
        rank = np.linalg.matrix_rank(self.gram, tol=RANK_TOLERANCE * self.gram[..., 0, 0], hermitian=True)
        known = (self.count >= MIN_QUADRATIC_POINTS) & (rank == 6)
        inverse = np.linalg.inv(np.where(known[..., None, None], self.gram, np.eye(6)))
        return _Quadratics(inverse @ self.right, inverse, known)


class _Points:
    """The points of a view on its board's lattice, padded by ``margin`` empty places on each side."""

    def __init__(self, view: Corners, board: Board, margin: int) -> None:
        """Lay out x, y, weight², u and v of every lattice point as a grid (rows, columns, 5)."""
        self.margin = margin
        self.grid = np.zeros((board.rows + 2 * margin, board.columns + 2 * margin, 5))
        row, column = np.divmod(np.arange(size(board)), board.columns)
        self.grid[row + margin, column + margin, :2] = lattice(board)
        row, column = np.divmod(view.ids, board.columns)
        self.grid[row + margin, column + margin, 2:] = np.column_stack([view.weights**2, view.uv])

    def sums(self, reach: int, first: int, stride: int, *, without_middle: bool = False) -> _Sums:
        """The sums over (2·``reach`` + 1)² points around every ``stride``-th one, from (``first``, ``first``) on."""
        middles = self._shifted(0, 0, first, stride)
        gram, right = np.zeros((*middles.shape[:2], 6, 6)), np.zeros((*middles.shape[:2], 6, 2))
        count = np.zeros(middles.shape[:2])
        for j, i in product(range(-reach, reach + 1), repeat=2):
            if without_middle and i == j == 0:
                continue
            points = self._shifted(j, i, first, stride)
            rows = _monomials((points[..., :2] - middles[..., :2]) / self.margin)
            weighted = points[..., 2:3] * rows
            gram += weighted[..., :, None] * rows[..., None, :]
            right += weighted[..., :, None] * points[..., None, 3:]
            count += points[..., 2] > 0
        return _Sums(gram, right, count)

    def _shifted(self, j: int, i: int, first: int, stride: int) -> Floats:
        """The points ``j`` rows and ``i`` columns from each middle: (…, …, 5)."""
        last = [extent - self.margin for extent in self.grid.shape[:2]]
        start = self.margin + first
        return self.grid[start + j : last[0] + j : stride, start + i : last[1] + i : stride]


def _monomials(p: Floats) -> Floats:
    """The monomials 1, a, b, a², ab, b² of points (…, 2): (…, 6)."""
    a, b = p[..., 0], p[..., 1]
    return np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=-1)
