"""ChArUco boards, and the dictionaries of their markers."""

from __future__ import annotations

import re
from dataclasses import dataclass

from pinholify.arrays import Floats, Ints
from pinholify.board.base import square_lattice
from pinholify.board.checkerboard import Checkerboard
from pinholify.errors import BoardError

MARKERS: dict[str, int] = {
    **{f"DICT_{bits}X{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "DICT_ARUCO_ORIGINAL": 1024,
    "DICT_ARUCO_MIP_36h12": 250,
    "DICT_APRILTAG_16h5": 30,
    "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320,
    "DICT_APRILTAG_36h11": 587,
}
"""OpenCV's dictionaries of square markers, with the number of markers in each."""

MAX_MARKER = 0.98
"""Side of a marker ÷ side of its square above which it cannot be separated from the black squares around it."""


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
            raise BoardError(f"unknown dictionary of markers '{self.dictionary}': choose one of {', '.join(MARKERS)}")
        needed = (self.columns + 1) * (self.rows + 1) // 2
        if needed > MARKERS[self.dictionary]:
            raise BoardError(
                f"the board needs {needed} markers, but {self.dictionary} has only {MARKERS[self.dictionary]}; "
                "choose a larger dictionary or a smaller board"
            )
        if not 0.0 < self.marker <= MAX_MARKER:
            raise BoardError(
                f"a marker of {self.marker:g} of a square was requested; it must be above 0 and at most "
                f"{MAX_MARKER:g}, so that white is left around it (0.5 to 0.8 works best)"
            )

    @property
    def spec(self) -> str:
        """``"charuco:9x7:DICT_4X4_100:0.5"``, in squares."""
        return f"charuco:{self.columns + 1}x{self.rows + 1}:{self.dictionary}:{self.marker:g}"

    @property
    def counted(self) -> str:
        """What the numbers of :attr:`spec` count."""
        return "squares, columns x rows, markers and marker ÷ square"

    @property
    def orientable(self) -> bool:
        """Always True: each marker is unique."""
        return True

    def places(self, column: Ints, row: Ints) -> Floats:
        """Corners one square apart."""
        return square_lattice(column, row)


def parse(text: str) -> Charuco:
    """The board that ``text`` describes, e.g. ``9x7:DICT_4X4_100:0.5``; raises BoardError."""
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4}):(\w+):(\d*\.?\d+)", text)
    if match is None:
        raise BoardError(
            f"'charuco:{text}' is not a board; write squares, OpenCV's name of the markers, and marker side ÷ square "
            "side, for example charuco:9x7:DICT_4X4_100:0.5"
        )
    return Charuco(int(match[1]) - 1, int(match[2]) - 1, match[3], float(match[4]))
