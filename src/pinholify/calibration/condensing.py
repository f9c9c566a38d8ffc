"""Fewer, better points from dense ones: what makes tens of thousands of correspondences quick to solve.

A board of thousands of points tells a smooth map far more often than it needs to hear it, and an exact Gaussian process
pays for n points with n³. So the lattice is cut into blocks of k × k points, k odd, and each block speaks through its
middle point: by the mean of its points, less what the image's bend adds to that mean. The bend is that of a quadratic
through the block and one more point on each side. What is left keeps 64 % of the points' information at
k = 3, has no bias up to the third order, and noise that hardly depends on the neighbours'.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.board import Board, lattice, size
from pinholify.corners import Corners, CornerSet

FEWEST = 7
"""Points of a quadratic, and one to spare."""

CUT = 1.0
"""Variances of a typical point: a block whose middle is known no better is cut, and left out."""

RANK_TOLERANCE = 1e-6


def condensed(corners: CornerSet, most: int) -> CornerSet:
    """``corners`` with at most about ``most`` points in all, the same size of blocks in all views.

    The given set where it has no more.
    """
    side = block_side(sum(len(view) for view in corners.found), most)
    return corners.with_views(condensed_view(view, corners.board, side) for view in corners.views)


def block_side(total: int, most: int) -> int:
    """The smallest odd side of blocks that leaves at most about ``most`` of ``total`` points."""
    return int(np.ceil(np.sqrt(total / most))) // 2 * 2 + 1 if total > most else 1


def condensed_view(view: Corners, board: Board, side: int) -> Corners:
    """The middle points of blocks of ``side`` × ``side`` points, each by all of its block; ``side`` is odd."""
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
    good = fit.known & (variance * np.median(view.weights) ** 2 < CUT)
    if 2 * good.sum() * side**2 < len(view):  # scattered over their lattice: blocks hold too few, so some are left out
        return view.select(np.arange(len(view)) % side**2 == 0)
    ids = np.arange(size(board)).reshape(board.rows, board.columns)[reach::side, reach::side]
    return replace(view, ids=ids[good], uv=uv[good], weights=variance[good] ** -0.5)


def foretold(view: Corners, board: Board, reach: int) -> tuple[Floats, Floats]:
    """Where the other points up to ``reach`` rows and columns away put each of ``view``: (n, 2) px, and how well.

    By a quadratic through them. The variance (n,) is in that of a point of weight 1; nan and inf where they do not
    tell.
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
    """``coefficients`` (…, 6, 2) of the monomials around each middle, ``inverse`` (…, 6, 6) their covariance, and
    whether the points tell them, ``known`` (…).
    """

    coefficients: Floats
    inverse: Floats
    known: Bools


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Over the points around each middle: ``gram`` Σ w² m mᵀ (…, 6, 6), ``right`` Σ w² m uvᵀ (…, 6, 2), ``count`` (…);
    m are the monomials of the places from the middle.
    """

    gram: Floats
    right: Floats
    count: Floats

    def solved(self) -> _Quadratics:
        """Least squares; a well-posed one stands in where the points do not tell."""
        rank = np.linalg.matrix_rank(self.gram, tol=RANK_TOLERANCE * self.gram[..., 0, 0], hermitian=True)
        known = (self.count >= FEWEST) & (rank == 6)
        inverse = np.linalg.inv(np.where(known[..., None, None], self.gram, np.eye(6)))
        return _Quadratics(inverse @ self.right, inverse, known)


class _Points:
    """The points of a view on its board's lattice, with empty places ``margin`` deep all around."""

    def __init__(self, view: Corners, board: Board, margin: int) -> None:
        """x, y, weight² and u, v of every lattice point, (rows, columns, 5)."""
        self.margin = margin
        self.grid = np.zeros((board.rows + 2 * margin, board.columns + 2 * margin, 5))
        row, column = np.divmod(np.arange(size(board)), board.columns)
        self.grid[row + margin, column + margin, :2] = lattice(board)
        row, column = np.divmod(view.ids, board.columns)
        self.grid[row + margin, column + margin, 2:] = np.column_stack([view.weights**2, view.uv])

    def sums(self, reach: int, first: int, stride: int, *, without_middle: bool = False) -> _Sums:
        """Over (2·``reach`` + 1)² points around every ``stride``-th one from (``first``, ``first``) on."""
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
        """What stands ``j`` rows and ``i`` columns from each middle, (…, …, 5)."""
        last = [extent - self.margin for extent in self.grid.shape[:2]]
        start = self.margin + first
        return self.grid[start + j : last[0] + j : stride, start + i : last[1] + i : stride]


def _monomials(p: Floats) -> Floats:
    """1, a, b, a², ab, b² of points (…, 2): (…, 6)."""
    a, b = p[..., 0], p[..., 1]
    return np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=-1)
