"""Grids of circles."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints
from pinholify.board.base import square_lattice
from pinholify.errors import BoardError


@dataclass(frozen=True, slots=True)
class CircleGrid:
    """A grid of ``columns`` × ``rows`` black discs; its points are their centres.

    If it is ``asymmetric``, the discs of odd rows are half way between those of even rows, as in OpenCV: the unit of
    length is then the distance between rows, and the discs of a row are two units apart. ``diameter`` is that of the
    discs, in units. Raises BoardError below 3×3 discs and for discs that touch.
    """

    columns: int
    rows: int
    asymmetric: bool = False
    diameter: float = 0.5

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 1000:
            raise BoardError(
                f"a grid of {self.columns}x{self.rows} circles was requested; it must be between 3x3 and 1000x1000"
            )
        touching = np.sqrt(2.0) if self.asymmetric else 1.0
        if not 0.0 < self.diameter < 0.9 * touching:
            raise BoardError(
                f"circles with a diameter of {self.diameter:g} spacings were requested; it must be above 0 and below "
                f"{0.9 * touching:.2f}, so that they do not touch"
            )

    @property
    def spec(self) -> str:
        """``"circles:7x5"`` or ``"circles:4x11:asymmetric"``, followed by the diameter unless that is 0.5."""
        parts = ["circles", f"{self.columns}x{self.rows}"] + ["asymmetric"] * self.asymmetric
        return ":".join(parts + [f"{self.diameter:g}"] * (self.diameter != 0.5))

    @property
    def counted(self) -> str:
        """What the numbers of :attr:`spec` count."""
        return "circles, columns x rows, and whether asymmetric"

    @property
    def orientable(self) -> bool:
        """True for an asymmetric grid with an odd number of rows: a half turn shifts its rows sideways."""
        return self.asymmetric and self.rows % 2 == 1

    def places(self, column: Ints, row: Ints) -> Floats:
        """Centres of the discs."""
        across = 2 * np.asarray(column) + np.asarray(row) % 2 if self.asymmetric else column
        return square_lattice(across, row)


def parse(text: str) -> CircleGrid:
    """The board that ``text`` describes, e.g. ``4x11:asymmetric``; raises BoardError."""
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4})(:asymmetric)?(?::(\d*\.?\d+))?", text)
    if match is None:
        raise BoardError(
            f"'circles:{text}' is not a board; write circles as columns x rows, for example circles:7x5 or "
            "circles:4x11:asymmetric, followed by their diameter ÷ spacing if that is not 0.5"
        )
    return CircleGrid(int(match[1]), int(match[2]), match[3] is not None, float(match[4] or 0.5))
