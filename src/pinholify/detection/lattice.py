"""A lattice of corners as it was found, and its ids on the board that was asked for.

An index (column, row) may start anywhere and point anywhere at first; only its handedness is fixed: columns ×
rows turn clockwise in the image, as x to the right and y down do.

Conventions for the ids (``interfaces.md`` of the project fixes the rest). What colour can tell, it decides:
on a board of an odd sum of columns and rows, and on a square board of an odd number, the square beyond corner
id 0, outside the lattice's corner, is black. What it cannot tell, the image decides: id 0 is the possible
corner nearest to the image's top left, and the result says that the orientation is assumed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import Board


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Corners with lattice ``index`` (n, 2) int64, ``uv`` (n, 2) px, ``weights`` (n,), and colours.

    ``phase`` is +1 where the square up and left of an index of even sum is bright, else -1.
    """

    index: Ints
    uv: Floats
    weights: Floats
    phase: int

    def __len__(self) -> int:
        """Number of corners."""
        return len(self.index)

    @property
    def extent(self) -> tuple[int, int]:
        """Columns and rows from the first to the last corner."""
        columns, rows = np.ptp(self.index, axis=0) + 1
        return int(columns), int(rows)

    def select(self, keep: Bools) -> Lattice:
        """The corners where ``keep`` (n,) is true."""
        return Lattice(self.index[keep], self.uv[keep], self.weights[keep], self.phase)

    def joined(self, index: Ints, uv: Floats) -> Lattice:
        """These corners and those at ``index`` (m, 2) and ``uv`` (m, 2), of weight 1."""
        indices, places = np.concatenate([self.index, index]), np.concatenate([self.uv, uv])
        return Lattice(indices, places, np.concatenate([self.weights, np.ones(len(index))]), self.phase)

    def moved(self, uv: Floats, weights: Floats | None = None) -> Lattice:
        """The same corners at the places ``uv`` (n, 2), of new ``weights`` (n,) where given."""
        return Lattice(self.index, uv, self.weights if weights is None else weights, self.phase)

    def shifted(self, by: tuple[int, int]) -> Lattice:
        """The same corners with ``by`` added to every index."""
        return Lattice(self.index + np.array(by), self.uv, self.weights, self.phase * (-1) ** (sum(by) % 2))

    def turned(self) -> Lattice:
        """The same corners counted after a quarter turn: rows become columns, columns backwards become rows.
        """
        turned = np.stack([self.index[:, 1], -self.index[:, 0]], axis=1)
        return Lattice(turned, self.uv, self.weights, -self.phase)

    def reflected(self) -> Lattice:
        """The same corners counted from the other end of each row, for a board seen in a mirror."""
        return Lattice(self.index * np.array([-1, 1]), self.uv, self.weights, -self.phase)

    def at_origin(self) -> Lattice:
        """The same corners with the smallest column and row at 0."""
        column, row = -self.index.min(axis=0)
        return self.shifted((int(column), int(row)))

    def ids(self, board: Board) -> Ints:
        """Row-major ids (n,) on ``board``."""
        return np.asarray(self.index[:, 1] * board.columns + self.index[:, 0])


def turns(lattice: Lattice, *, mirrored: bool) -> list[Lattice]:
    """The four ways to count ``lattice`` with the handedness of a board seen directly, or in a mirror."""
    ways = [lattice.reflected() if mirrored else lattice]
    for _ in range(3):
        ways.append(ways[-1].turned())
    return ways


def orient(ways: list[Lattice], board: Board) -> tuple[Lattice, bool]:
    """Of the possible ``ways``, all with final indices on ``board``, the one that the conventions choose.

    The second value says whether the image, not the colours, had to choose.
    """
    if board.orientable or board.columns == board.rows:
        ways = [way for way in ways if way.phase < 0] or ways
    return min(ways, key=_distance_of_origin), len(ways) > 1


def _distance_of_origin(lattice: Lattice) -> float:
    """Distance (px) of index (0, 0) from the image's top left; by an affine fit where that corner is not
    seen.
    """
    first = (lattice.index == 0).all(axis=1)
    if first.any():
        return float(np.linalg.norm(lattice.uv[first][0]))
    design = np.column_stack([lattice.index, np.ones(len(lattice))])
    return float(np.linalg.norm(np.linalg.lstsq(design, lattice.uv, rcond=None)[0][2]))
