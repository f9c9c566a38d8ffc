"""Calibration boards: what is printed on them, and where their points lie.

Lattice coordinates are in squares (for an AprilGrid in sides of a tag, for a circle grid or the nodes of a screen in
spacings): x to the right along a row, y down, row-major ids with x fastest (id = row · columns + column). A new kind
of board is a file with its class and the function ``parse``, and one line in ``BOARD_KINDS``.
"""

from __future__ import annotations

from collections.abc import Callable

from pinholify.board import aprilgrid, charuco, checkerboard, circles, screen
from pinholify.board.aprilgrid import FAMILIES, AprilGrid
from pinholify.board.base import Board, lattice, lattice_points, outline, size
from pinholify.board.charuco import MARKERS, Charuco
from pinholify.board.checkerboard import Checkerboard
from pinholify.board.circles import CircleGrid
from pinholify.board.screen import Screen
from pinholify.errors import BoardError

BOARD_KINDS: dict[str, Callable[[str], Board]] = {
    "checkerboard": checkerboard.parse,
    "charuco": charuco.parse,
    "aprilgrid": aprilgrid.parse,
    "circles": circles.parse,
    "gray": screen.parse,
}
"""Readers of board descriptions by the word before the first colon; a bare size is a checkerboard."""


def parse_board(text: str) -> Board:
    """The board that ``text`` describes, e.g. ``15x9``; raises BoardError with what may be written instead."""
    kind, colon, rest = text.strip().partition(":")
    if not colon:
        return BOARD_KINDS["checkerboard"](kind)
    if kind not in BOARD_KINDS:
        raise BoardError(f"unknown kind of board '{kind}': choose one of {', '.join(BOARD_KINDS)}")
    return BOARD_KINDS[kind](rest)


__all__ = [
    "BOARD_KINDS",
    "FAMILIES",
    "MARKERS",
    "AprilGrid",
    "Board",
    "Charuco",
    "Checkerboard",
    "CircleGrid",
    "Screen",
    "lattice",
    "lattice_points",
    "outline",
    "parse_board",
    "size",
]
