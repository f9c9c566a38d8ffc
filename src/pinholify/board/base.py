"""What every board has in common."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from pinholify.arrays import Floats, Ints


@runtime_checkable
class Board(Protocol):
    """A flat target whose points lie in straight rows and columns."""

    @property
    def columns(self) -> int:
        """Lattice points along x."""
        ...

    @property
    def rows(self) -> int:
        """Lattice points along y."""
        ...

    @property
    def spec(self) -> str:
        """The text that :func:`pinholify.board.parse_board` reads back as this board."""
        ...

    @property
    def counted(self) -> str:
        """What the numbers of :attr:`spec` count, for messages."""
        ...

    @property
    def orientable(self) -> bool:
        """Whether an image of the board differs from one of the board rotated by 180°."""
        ...

    def places(self, column: Ints, row: Ints) -> Floats:
        """Lattice coordinates (n, 2) float64 of the points in ``column`` (n,) and ``row`` (n,)."""
        ...


def size(board: Board) -> int:
    """Number of lattice points of ``board``."""
    return board.columns * board.rows


def lattice(board: Board) -> Floats:
    """Lattice coordinates of all points of ``board``, (columns·rows, 2) float64 in squares, in id order."""
    return lattice_points(board, np.arange(size(board)))


def lattice_points(board: Board, ids: Ints) -> Floats:
    """Lattice coordinates of the points ``ids`` (n,) of ``board``: (n, 2) float64 in squares."""
    row, column = np.divmod(np.asarray(ids), board.columns)
    return board.places(column, row)


def outline(board: Board) -> tuple[Floats, Floats]:
    """The smallest and the largest lattice coordinates (2,) of the points of ``board``, in squares."""
    points = lattice(board)
    return points.min(axis=0), points.max(axis=0)


def square_lattice(column: Ints, row: Ints) -> Floats:
    """Lattice coordinates (n, 2) float64 of points one unit apart in ``column`` (n,) and ``row`` (n,)."""
    return np.stack([column, row], axis=-1).astype(np.float64)
