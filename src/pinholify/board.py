"""Calibration boards: what is printed on them, and where their points lie.

Lattice coordinates are in squares: x to the right along a row, y down, row-major ids with x fastest
(id = row · columns + column). A new kind of board is one class here or beside, and one line in ``BOARD_KINDS``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from pinholify.arrays import Floats, Ints
from pinholify.errors import BoardError


@runtime_checkable
class Board(Protocol):
    """A flat target whose points lie on a square lattice."""

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
        """The text that :func:`parse_board` reads back as this board."""
        ...

    @property
    def orientable(self) -> bool:
        """Whether a picture tells the board from the same board turned by 180°."""
        ...


@dataclass(frozen=True, slots=True)
class Checkerboard:
    """A checkerboard of ``columns`` × ``rows`` inner corners; raises BoardError below 3×3."""

    columns: int
    rows: int

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise BoardError(
                f"a board of {self.columns}x{self.rows} inner corners was asked for; at least 3x3 are needed: "
                "count the corners where four squares meet, columns x rows"
            )
        if self.columns > 1000 or self.rows > 1000:
            raise BoardError(f"a board of {self.columns}x{self.rows} inner corners was asked for; at most 1000x1000")

    @property
    def spec(self) -> str:
        """``"15x9"``."""
        return f"{self.columns}x{self.rows}"

    @property
    def orientable(self) -> bool:
        """True where colour fixes the orientation: columns + rows is odd."""
        return (self.columns + self.rows) % 2 == 1


def size(board: Board) -> int:
    """Number of lattice points of ``board``."""
    return board.columns * board.rows


def lattice(board: Board) -> Floats:
    """Lattice coordinates of all points of ``board``, (columns·rows, 2) float64 in squares, in id order."""
    return lattice_points(board, np.arange(size(board)))


def lattice_points(board: Board, ids: Ints) -> Floats:
    """Lattice coordinates of the points ``ids`` (n,) of ``board``: (n, 2) float64 in squares."""
    row, column = np.divmod(np.asarray(ids), board.columns)
    return np.stack([column, row], axis=-1).astype(np.float64)


def _checkerboard(text: str) -> Checkerboard:
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4})", text)
    if match is None:
        raise BoardError(
            f"'{text}' is no board; write the inner corners of a checkerboard as columns x rows, for example 15x9"
        )
    return Checkerboard(int(match[1]), int(match[2]))


BOARD_KINDS: dict[str, Callable[[str], Board]] = {"checkerboard": _checkerboard}
"""Readers of board descriptions by the word before the first colon; a bare size is a checkerboard."""


def parse_board(text: str) -> Board:
    """The board that ``text`` describes, e.g. ``15x9``; raises BoardError with what may be written instead."""
    kind, colon, rest = text.strip().partition(":")
    if not colon:
        return BOARD_KINDS["checkerboard"](kind)
    if kind not in BOARD_KINDS:
        raise BoardError(f"'{kind}' is no kind of board this version knows; it knows: {', '.join(BOARD_KINDS)}")
    return BOARD_KINDS[kind](rest)
