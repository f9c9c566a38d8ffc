"""Checkerboards."""

from __future__ import annotations

import re
from dataclasses import dataclass

from pinholify.arrays import Floats, Ints
from pinholify.board.base import square_lattice
from pinholify.errors import BoardError


@dataclass(frozen=True, slots=True)
class Checkerboard:
    """A checkerboard of ``columns`` × ``rows`` inner corners; raises BoardError below 3×3."""

    columns: int
    rows: int

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise BoardError(
                f"a board of {self.columns}x{self.rows} inner corners was requested; at least 3x3 are needed: "
                "count the corners where four squares meet, columns x rows"
            )
        if self.columns > 1000 or self.rows > 1000:
            raise BoardError(
                f"a board of {self.columns}x{self.rows} inner corners was requested; give at most 1000x1000"
            )

    @property
    def spec(self) -> str:
        """``"15x9"``."""
        return f"{self.columns}x{self.rows}"

    @property
    def counted(self) -> str:
        """What the numbers of :attr:`spec` count."""
        return "inner corners, columns x rows"

    @property
    def orientable(self) -> bool:
        """True where colour fixes the orientation, i.e. columns + rows is odd."""
        return (self.columns + self.rows) % 2 == 1

    def places(self, column: Ints, row: Ints) -> Floats:
        """Corners one square apart."""
        return square_lattice(column, row)


def parse(text: str) -> Checkerboard:
    """The board that ``text`` describes, e.g. ``15x9``; raises BoardError."""
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4})", text)
    if match is None:
        raise BoardError(
            f"'{text}' is not a board; write the inner corners of a checkerboard as columns x rows, for example 15x9"
        )
    return Checkerboard(int(match[1]), int(match[2]))
