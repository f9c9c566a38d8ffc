"""Screens that show Gray codes."""

from __future__ import annotations

import re
from dataclasses import dataclass

from pinholify.arrays import Floats, Ints
from pinholify.board.base import lattice_points, square_lattice
from pinholify.errors import BoardError


@dataclass(frozen=True, slots=True)
class Screen:
    """A screen of ``width`` × ``height`` pixels that shows Gray codes; its points are nodes ``spacing`` pixels apart.

    The unit of length is the spacing. The first node is the centre of the top left ``spacing`` × ``spacing`` pixels,
    and so on. Raises BoardError for spacings below 4 px, and unless there are 3 to 4000 nodes in each direction.
    """

    width: int
    height: int
    spacing: int = 16

    def __post_init__(self) -> None:
        if self.spacing < 4 or min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 4000:
            raise BoardError(
                f"nodes {self.spacing} px apart on a screen of {self.width}x{self.height} px were requested; the "
                "spacing must be 4 px or more, with 3 to 4000 nodes in each direction"
            )

    @property
    def columns(self) -> int:
        """Nodes along x."""
        return self.width // self.spacing

    @property
    def rows(self) -> int:
        """Nodes along y."""
        return self.height // self.spacing

    @property
    def spec(self) -> str:
        """``"gray:1920x1080:16"``: the screen's size and the spacing of the nodes, px."""
        return f"gray:{self.width}x{self.height}:{self.spacing}"

    @property
    def counted(self) -> str:
        """What the numbers of :attr:`spec` count."""
        return "pixels of the screen"

    @property
    def orientable(self) -> bool:
        """Always True: each pixel is identified."""
        return True

    def places(self, column: Ints, row: Ints) -> Floats:
        """The nodes."""
        return square_lattice(column, row)

    def screen_pixels(self, ids: Ints) -> Floats:
        """Positions (n, 2) of the nodes ``ids`` (n,) on the screen, in px, integer = pixel centre."""
        return (lattice_points(self, ids) + 0.5) * self.spacing - 0.5


def parse(text: str) -> Screen:
    """The screen that ``text`` describes, e.g. ``1920x1080:16``; raises BoardError."""
    match = re.fullmatch(r"(\d{1,5})[xX×](\d{1,5})(?::(\d{1,4}))?", text)
    if match is None:
        raise BoardError(
            f"'gray:{text}' is not a screen; write its width x height in px, followed by the spacing of the nodes if "
            "that is not 16 px, for example gray:1920x1080 or gray:1920x1080:24"
        )
    return Screen(int(match[1]), int(match[2]), int(match[3] or 16))
