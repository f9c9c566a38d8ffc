"""Calibration boards: what is printed on them, and where their points lie.

Lattice coordinates are in squares (for an AprilGrid in sides of a tag, for a circle grid or the nodes of a screen in
spacings): x to the right along a row, y down, row-major ids with x fastest (id = row · columns + column). A new kind
of board is a class and one line in ``BOARD_KINDS``.
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
        """The text that :func:`parse_board` reads back as this board."""
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
        return _square_lattice(column, row)


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

LARGEST_MARKER = 0.98
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
        if not 0.0 < self.marker <= LARGEST_MARKER:
            raise BoardError(
                f"a marker of {self.marker:g} of a square was requested; it must be above 0 and at most "
                f"{LARGEST_MARKER:g}, so that white is left around it (0.5 to 0.8 works best)"
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
        return _square_lattice(column, row)


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
        return _square_lattice(across, row)


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
        return _square_lattice(column, row)

    def screen_pixels(self, ids: Ints) -> Floats:
        """Positions (n, 2) of the nodes ``ids`` (n,) on the screen, in px, integer = pixel centre."""
        return (lattice_points(self, ids) + 0.5) * self.spacing - 0.5


def _square_lattice(column: Ints, row: Ints) -> Floats:
    return np.stack([column, row], axis=-1).astype(np.float64)


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


def _checkerboard(text: str) -> Checkerboard:
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4})", text)
    if match is None:
        raise BoardError(
            f"'{text}' is not a board; write the inner corners of a checkerboard as columns x rows, for example 15x9"
        )
    return Checkerboard(int(match[1]), int(match[2]))


def _charuco(text: str) -> Charuco:
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4}):(\w+):(\d*\.?\d+)", text)
    if match is None:
        raise BoardError(
            f"'charuco:{text}' is not a board; write squares, OpenCV's name of the markers, and marker side ÷ square "
            "side, for example charuco:9x7:DICT_4X4_100:0.5"
        )
    return Charuco(int(match[1]) - 1, int(match[2]) - 1, match[3], float(match[4]))


def _aprilgrid(text: str) -> AprilGrid:
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4}):(\w+):(\d*\.?\d+)", text)
    if match is None:
        raise BoardError(
            f"'aprilgrid:{text}' is not a board; write tags, their family, and gap ÷ tag side, for example "
            "aprilgrid:6x6:tag36h11:0.3"
        )
    return AprilGrid(int(match[1]), int(match[2]), match[3], float(match[4]))


def _circles(text: str) -> CircleGrid:
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4})(:asymmetric)?(?::(\d*\.?\d+))?", text)
    if match is None:
        raise BoardError(
            f"'circles:{text}' is not a board; write circles as columns x rows, for example circles:7x5 or "
            "circles:4x11:asymmetric, followed by their diameter ÷ spacing if that is not 0.5"
        )
    return CircleGrid(int(match[1]), int(match[2]), match[3] is not None, float(match[4] or 0.5))


def _screen(text: str) -> Screen:
    match = re.fullmatch(r"(\d{1,5})[xX×](\d{1,5})(?::(\d{1,4}))?", text)
    if match is None:
        raise BoardError(
            f"'gray:{text}' is not a screen; write its width x height in px, followed by the spacing of the nodes if "
            "that is not 16 px, for example gray:1920x1080 or gray:1920x1080:24"
        )
    return Screen(int(match[1]), int(match[2]), int(match[3] or 16))


BOARD_KINDS: dict[str, Callable[[str], Board]] = {
    "checkerboard": _checkerboard,
    "charuco": _charuco,
    "aprilgrid": _aprilgrid,
    "circles": _circles,
    "gray": _screen,
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
