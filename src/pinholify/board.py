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


MARKERS: dict[str, int] = {
    **{f"DICT_{bits}X{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "DICT_ARUCO_ORIGINAL": 1024,
    "DICT_ARUCO_MIP_36h12": 250,
    "DICT_APRILTAG_16h5": 30,
    "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320,
    "DICT_APRILTAG_36h11": 587,
}
"""OpenCV's dictionaries of square markers, and how many markers each has."""


@dataclass(frozen=True, slots=True)
class Charuco:
    """A ChArUco board: a checkerboard with an ArUco marker in each white square.

    ``columns`` × ``rows`` are its inner corners, one less than its squares each way; ``dictionary`` is one of
    ``MARKERS``; ``marker`` is a marker's side ÷ a square's. Raises BoardError below 3×3 inner corners, for an unknown
    or too small dictionary, and for a marker that does not fit in its square.
    """

    columns: int
    rows: int
    dictionary: str
    marker: float

    def __post_init__(self) -> None:
        Checkerboard(self.columns, self.rows)
        if self.dictionary not in MARKERS:
            raise BoardError(f"'{self.dictionary}' is no dictionary of markers; these are: {', '.join(MARKERS)}")
        needed = (self.columns + 1) * (self.rows + 1) // 2
        if needed > MARKERS[self.dictionary]:
            raise BoardError(
                f"the board needs {needed} markers, but {self.dictionary} has only {MARKERS[self.dictionary]}; "
                "name a larger dictionary or a smaller board"
            )
        if not 0.0 < self.marker < 1.0:
            raise BoardError(f"a marker of {self.marker:g} of a square was asked for; it must be between 0 and 1")

    @property
    def spec(self) -> str:
        """``"charuco:9x7:DICT_4X4_100:0.5"``, in squares."""
        return f"charuco:{self.columns + 1}x{self.rows + 1}:{self.dictionary}:{self.marker:g}"

    @property
    def orientable(self) -> bool:
        """Always: each marker is known by itself."""
        return True


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


def _charuco(text: str) -> Charuco:
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4}):(\w+):(\d*\.?\d+)", text)
    if match is None:
        raise BoardError(
            f"'charuco:{text}' is no board; write squares, OpenCV's name of the markers, and marker side ÷ square "
            "side, for example charuco:9x7:DICT_4X4_100:0.5"
        )
    return Charuco(int(match[1]) - 1, int(match[2]) - 1, match[3], float(match[4]))


BOARD_KINDS: dict[str, Callable[[str], Board]] = {"checkerboard": _checkerboard, "charuco": _charuco}
"""Readers of board descriptions by the word before the first colon; a bare size is a checkerboard."""


def parse_board(text: str) -> Board:
    """The board that ``text`` describes, e.g. ``15x9``; raises BoardError with what may be written instead."""
    kind, colon, rest = text.strip().partition(":")
    if not colon:
        return BOARD_KINDS["checkerboard"](kind)
    if kind not in BOARD_KINDS:
        raise BoardError(f"'{kind}' is no kind of board this version knows; it knows: {', '.join(BOARD_KINDS)}")
    return BOARD_KINDS[kind](rest)
