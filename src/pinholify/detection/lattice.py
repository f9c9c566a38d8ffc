"""A lattice of corners as it was found, and its ids on the requested board.

The origin and the direction of the indices (column, row) are arbitrary at first; only their handedness is fixed: the
turn from columns to rows is clockwise in the image, as from x (right) to y (down).

Ids are row-major, id = row · columns + column. Where the colours determine the orientation, they decide it: if the sum
of columns and rows is odd, and on square boards with an odd number of columns, the square diagonally beyond corner 0 is
black. Otherwise corner 0 is the possible one nearest to the image's top left, and the result is marked as an assumed
orientation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import Board


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Corners with lattice ``index`` (n, 2) int64, ``uv`` (n, 2) px, ``weights`` (n,), and colours.

    ``phase`` is +1 if the square up and left of an index of even sum is bright, else -1.
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
        """Number of columns and rows from the first to the last corner."""
        columns, rows = np.ptp(self.index, axis=0) + 1
        return int(columns), int(rows)

    def select(self, keep: Bools) -> Lattice:
        """The corners where ``keep`` (n,) is true."""
        return replace(self, index=self.index[keep], uv=self.uv[keep], weights=self.weights[keep])

    def joined(self, index: Ints, uv: Floats) -> Lattice:
        """These corners and those of ``index`` (m, 2) at ``uv`` (m, 2) px, of weight 1."""
        return replace(
            self,
            index=np.concatenate([self.index, index]),
            uv=np.concatenate([self.uv, uv]),
            weights=np.concatenate([self.weights, np.ones(len(index))]),
        )

    def moved(self, uv: Floats, weights: Floats | None = None) -> Lattice:
        """The same corners at the pixels ``uv`` (n, 2), with new ``weights`` (n,) where given."""
        return replace(self, uv=uv, weights=self.weights if weights is None else weights)

    def shifted(self, by: tuple[int, int]) -> Lattice:
        """The same corners with ``by`` added to every index."""
        return replace(self, index=self.index + np.array(by), phase=self.phase * (-1) ** (sum(by) % 2))

    def turned(self) -> Lattice:
        """The same corners numbered after a quarter turn: rows become columns, reversed columns become rows."""
        turned = np.stack([self.index[:, 1], -self.index[:, 0]], axis=1)
        return replace(self, index=turned, phase=-self.phase)

    def reflected(self) -> Lattice:
        """The same corners numbered from the other end of each row, for a board seen in a mirror."""
        return replace(self, index=self.index * np.array([-1, 1]), phase=-self.phase)

    def at_origin(self) -> Lattice:
        """The same corners with the smallest column and row at 0."""
        column, row = -self.index.min(axis=0)
        return self.shifted((int(column), int(row)))

    def ids(self, board: Board) -> Ints:
        """Row-major ids (n,) on ``board``."""
        return np.asarray(self.index[:, 1] * board.columns + self.index[:, 0])


def turns(lattice: Lattice, *, mirrored: bool) -> list[Lattice]:
    """The four numberings of ``lattice`` with the handedness of a board seen directly, or in a mirror."""
    ways = [lattice.reflected() if mirrored else lattice]
    for _ in range(3):
        ways.append(ways[-1].turned())
    return ways


def orient(ways: list[Lattice], board: Board) -> tuple[Lattice, bool]:
    """The one of the possible numberings ``ways``, all with final indices on ``board``, that the conventions choose.

    The second value is whether it was chosen by the image rather than by the colours.
    """
    if board.orientable or board.columns == board.rows:
        ways = [way for way in ways if way.phase < 0] or ways
    return min(ways, key=_distance_of_origin), len(ways) > 1


def _distance_of_origin(lattice: Lattice) -> float:
    """Distance (px) of index (0, 0) from the image's top left; by an affine fit where that corner is not visible."""
    first = (lattice.index == 0).all(axis=1)
    if first.any():
        return float(np.linalg.norm(lattice.uv[first][0]))
    design = np.column_stack([lattice.index, np.ones(len(lattice))])
    return float(np.linalg.norm(np.linalg.lstsq(design, lattice.uv, rcond=None)[0][2]))
