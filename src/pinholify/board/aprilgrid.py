"""Kalibr's grids of AprilTags."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints
from pinholify.board.charuco import MARKERS
from pinholify.errors import BoardError

FAMILIES: dict[str, str] = {
    "tag16h5": "DICT_APRILTAG_16h5",
    "tag25h9": "DICT_APRILTAG_25h9",
    "tag36h10": "DICT_APRILTAG_36h10",
    "tag36h11": "DICT_APRILTAG_36h11",
}
"""AprilTag's names of its families, with OpenCV's names of the same dictionaries."""


@dataclass(frozen=True, slots=True)
class AprilGrid:
    """A grid of AprilTags as Kalibr prints it: ``across`` × ``down`` tags and black squares between their corners.

    ``family`` is one of ``FAMILIES``; ``gap`` is the white between two tags ÷ a tag's side, which is the unit of
    length. Tag 0 is at the bottom left, as in Kalibr; the corners are numbered as on every board, from the top left:
    2·across columns and 2·down rows of them. Raises BoardError below 2×2 tags, for an unknown or too small family, and
    for a gap outside 0 … 1.
    """

    across: int
    down: int
    family: str
    gap: float

    def __post_init__(self) -> None:
        if min(self.across, self.down) < 2:
            raise BoardError(f"an AprilGrid of {self.across}x{self.down} tags was requested; at least 2x2 are needed")
        if self.family not in FAMILIES:
            raise BoardError(f"unknown family of AprilTags '{self.family}': choose one of {', '.join(FAMILIES)}")
        needed, known = self.across * self.down, MARKERS[FAMILIES[self.family]]
        if needed > known:
            raise BoardError(
                f"the board needs {needed} tags, but {self.family} has only {known}; choose a larger family or a "
                "smaller board"
            )
        if not 0.0 < self.gap <= 1.0:
            raise BoardError(f"a gap of {self.gap:g} of a tag was requested; it must be above 0 and at most 1")

    @property
    def columns(self) -> int:
        """Two for each tag."""
        return 2 * self.across

    @property
    def rows(self) -> int:
        """Two for each tag."""
        return 2 * self.down

    @property
    def spec(self) -> str:
        """``"aprilgrid:6x6:tag36h11:0.3"``, in tags."""
        return f"aprilgrid:{self.across}x{self.down}:{self.family}:{self.gap:g}"

    @property
    def counted(self) -> str:
        """What the numbers of :attr:`spec` count."""
        return "tags, columns x rows, family and gap ÷ tag"

    @property
    def orientable(self) -> bool:
        """Always True: each tag is unique."""
        return True

    def places(self, column: Ints, row: Ints) -> Floats:
        """Corners at the ends of tags."""
        tag, end = np.divmod(np.stack([column, row], axis=-1), 2)
        return np.asarray(tag * (1.0 + self.gap) + end)

    def tag_number(self, column: Ints, row: Ints) -> Ints:
        """Numbers of the tags in ``column`` and ``row`` of tags, row 0 at the top; Kalibr numbers from the bottom."""
        return np.asarray((self.down - 1 - np.asarray(row)) * self.across + np.asarray(column))


def parse(text: str) -> AprilGrid:
    """The board that ``text`` describes, e.g. ``6x6:tag36h11:0.3``; raises BoardError."""
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4}):(\w+):(\d*\.?\d+)", text)
    if match is None:
        raise BoardError(
            f"'aprilgrid:{text}' is not a board; write tags, their family, and gap ÷ tag side, for example "
            "aprilgrid:6x6:tag36h11:0.3"
        )
    return AprilGrid(int(match[1]), int(match[2]), match[3], float(match[4]))
