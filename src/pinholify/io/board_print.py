"""Drawing boards true to scale, as PDF, SVG or PNG according to the file's ending.

A board becomes an :class:`Artwork` in squares, the artwork a :class:`Sheet` in millimetres, and the sheet a file. A new
kind of board needs one function and one line in ``ARTWORKS``, a new format one function and one line in ``FORMATS``.
Lengths are in mm from the top left of the page, x to the right and y down.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from pinholify.board import FAMILIES, AprilGrid, Board, Charuco, Checkerboard, CircleGrid, Screen, lattice, outline
from pinholify.errors import BoardError, InputError
from pinholify.io.files import atomic_path, writing_text

if TYPE_CHECKING:
    from PIL import ImageDraw

PAGES: dict[str, tuple[float, float]] = {
    "A0": (841, 1189),
    "A1": (594, 841),
    "A2": (420, 594),
    "A3": (297, 420),
    "A4": (210, 297),
    "A5": (148, 210),
    "Letter": (215.9, 279.4),
    "Legal": (215.9, 355.6),
    "Tabloid": (279.4, 431.8),
}
"""Width and height of the named page sizes, upright, in mm."""

MARGIN = 5.0
"""White margin on every side of a page, which printers cannot print on, in mm."""

FOOTER = 9.0
"""Height of the line of text and the ruler at the foot of a page, in mm."""

PNG_DPI = 300
"""Resolution of a PNG before rounding to a whole number of pixels per square."""

_PNG_MAX_PIXELS = 250_000_000
_POINTS_PER_MM = 72 / 25.4
_TEXT_HEIGHT = 2.6
_RULER_LINE = 0.2


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A black rectangle: its top left corner, width and height."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Disc:
    """A black disc: its centre and its radius."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True, slots=True)
class Label:
    """Text whose baseline begins at (x, y); ``size`` is the height of the font."""

    x: float
    y: float
    size: float
    text: str


@dataclass(frozen=True, slots=True)
class Artwork:
    """The black shapes of a board, in squares from its top left corner, and its size in squares.

    ``origin`` is the position of the board's point 0; ``unit`` is the text that describes squares of "{}" mm.
    """

    columns: float
    rows: float
    black: tuple[Rectangle | Disc, ...]
    origin: tuple[float, float]
    unit: str = "squares of {} mm"


@dataclass(frozen=True, slots=True)
class Sheet:
    """A page ready to be written: its size and all its black shapes, in mm."""

    width: float
    height: float
    square: float
    title: str
    black: tuple[Rectangle | Disc, ...]
    labels: tuple[Label, ...]


def write_board(board: Board, path: str | os.PathLike[str], *, square_mm: float, page: str = "A4") -> Sheet:
    """Write ``board`` with squares of ``square_mm`` to ``path`` (.pdf, .svg or .png) and return the sheet.

    ``page`` is a name in ``PAGES``, in whichever orientation fits better, or ``WxHmm``, used unchanged. Raises
    BoardError if the board does not fit, InputError for an unknown page or ending, and OutputError if the file cannot
    be written.
    """
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        found = f"ends in '{ending}'" if ending else "has no ending"
        raise InputError(f"'{os.fspath(path)}' {found}; a board can be written as {', '.join(FORMATS)}")
    sheet = lay_out(board, square_mm=square_mm, page=page)
    FORMATS[ending](sheet, path)
    return sheet


# --- from the board to the sheet ------------------------------------------------------------------


def _checkerboard(board: Checkerboard) -> Artwork:
    columns, rows = board.columns + 1, board.rows + 1
    black = (Rectangle(x, y, 1, 1) for y in range(rows) for x in range(columns) if (x + y) % 2 == 0)
    return Artwork(columns, rows, tuple(black), (1.0, 1.0))


def _charuco(board: Charuco) -> Artwork:
    """The checkerboard, with the markers in its white squares, row by row."""
    squares = _checkerboard(Checkerboard(board.columns, board.rows))
    columns, rows = board.columns + 1, board.rows + 1
    white = [(x, y) for y in range(rows) for x in range(columns) if (x + y) % 2 == 1]
    margin = (1.0 - board.marker) / 2.0
    black = list(squares.black)
    for number, (x, y) in enumerate(white):
        black += _cells(_marker(board.dictionary, number, border=1), x + margin, y + margin, board.marker)
    return Artwork(columns, rows, tuple(black), squares.origin)


def _aprilgrid(board: AprilGrid) -> Artwork:
    """Kalibr's board: tags with a border of two cells, and black squares that touch their corners.

    OpenCV's AprilTags are upside down compared with AprilTag's own and Kalibr's.
    """
    step, gap = 1.0 + board.gap, board.gap
    black: list[Rectangle] = []
    for y in range(board.down):
        for x in range(board.across):
            number = int(board.tag_number(np.array(x), np.array(y)))
            marker = _marker(FAMILIES[board.family], number, border=2)[::-1, ::-1]
            black += _cells(marker, gap + x * step, gap + y * step, 1.0)
    between = (Rectangle(x * step, y * step, gap, gap) for y in range(board.down + 1) for x in range(board.across + 1))
    size = board.across * step + gap, board.down * step + gap
    return Artwork(*size, (*black, *between), (gap, gap), "tags of {} mm")


def _circles(board: CircleGrid) -> Artwork:
    radius = board.diameter / 2.0
    _, (width, height) = outline(board)
    discs = (Disc(x + radius, y + radius, radius) for x, y in lattice(board).tolist())
    unit = "rows {} mm apart" if board.asymmetric else "circles {} mm apart"
    return Artwork(float(width) + board.diameter, float(height) + board.diameter, tuple(discs), (radius, radius), unit)


def _marker(dictionary: str, number: int, *, border: int) -> NDArray[np.bool_]:
    """The black cells (cells, cells) of an OpenCV marker with a black border of ``border`` cells."""
    import cv2

    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    cells = markers.markerSize + 2 * border
    return np.asarray(cv2.aruco.generateImageMarker(markers, number, cells, borderBits=border) == 0)


def _cells(marker: NDArray[np.bool_], left: float, top: float, side: float) -> list[Rectangle]:
    """The black cells of ``marker`` (cells, cells), from (left, top); each run of black in a row is one rectangle."""
    cell = side / len(marker)
    return [
        Rectangle(left + start * cell, top + row * cell, (end - start) * cell, cell)
        for row, line in enumerate(marker)
        for start, end in _runs(line)
    ]


def _runs(line: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Start and end of each run of true cells."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


ARTWORKS: dict[type, Callable[[Any], Artwork]] = {
    Checkerboard: _checkerboard,
    Charuco: _charuco,
    AprilGrid: _aprilgrid,
    CircleGrid: _circles,
}
"""Kind of board → the function that draws it."""


def lay_out(board: Board, *, square_mm: float, page: str) -> Sheet:
    """The sheet of ``board``: the board in the middle, above a footer with its description and a ruler.

    At least ``MARGIN`` of white is left around the board. Raises BoardError for a screen, and if the board does not
    fit, with the largest square that does; InputError for an unknown page.
    """
    if not (math.isfinite(square_mm) and square_mm > 0):
        raise BoardError(f"a square of {square_mm:g} mm was requested; a positive length is needed")
    if isinstance(board, Screen):
        raise BoardError(f"{board.spec} is a screen, not a print: 'pinholify gray-code make' writes its patterns")
    if type(board) not in ARTWORKS:
        kinds = ", ".join(kind.__name__ for kind in ARTWORKS)
        raise BoardError(f"a board of the kind {type(board).__name__} cannot be printed; these can: {kinds}")
    artwork = ARTWORKS[type(board)](board)
    width, height = max(_orientations(page), key=lambda size: _largest_square(artwork, *size))
    largest = _largest_square(artwork, width, height)
    if square_mm > largest * (1 + 1e-9):
        raise BoardError(_does_not_fit(board, artwork, square_mm, page, largest))
    left = (width - artwork.columns * square_mm) / 2
    top = (height - MARGIN - FOOTER - artwork.rows * square_mm) / 2
    squares = tuple(_placed(shape, left, top, square_mm) for shape in artwork.black)
    unit = artwork.unit.format(f"{square_mm:g}")
    ruler, labels = _footer(board, unit, width, height)
    return Sheet(width, height, square_mm, f"{board.spec}, {unit}", squares + ruler, labels)


def _placed(shape: Rectangle | Disc, left: float, top: float, scale: float) -> Rectangle | Disc:
    x, y = left + shape.x * scale, top + shape.y * scale
    if isinstance(shape, Disc):
        return Disc(x, y, shape.radius * scale)
    return Rectangle(x, y, shape.width * scale, shape.height * scale)


def _orientations(page: str) -> list[tuple[float, float]]:
    """The possible sizes (width, height) of ``page``, in mm."""
    named = {name.lower(): size for name, size in PAGES.items()}.get(page.strip().lower())
    if named:
        return [named, (named[1], named[0])]
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*[xX×]\s*(\d+(?:\.\d+)?)\s*mm", page.strip())
    if match is None:
        raise InputError(f"unknown page '{page}': choose one of {', '.join(PAGES)}, or a size such as 600x400mm")
    width, height = float(match[1]), float(match[2])
    if min(width, height) < 30 or max(width, height) > 5000:
        size = f"{width:g} x {height:g} mm"
        raise InputError(f"a page of {size} was requested; its sides must be between 30 and 5000 mm")
    return [(width, height)]


def _largest_square(artwork: Artwork, width: float, height: float) -> float:
    """The largest square, in mm, with which the artwork fits between margins and footer."""
    return min((width - 2 * MARGIN) / artwork.columns, (height - 3 * MARGIN - FOOTER) / artwork.rows)


def _does_not_fit(board: Board, artwork: Artwork, square_mm: float, page: str, largest: float) -> str:
    needed = f"{artwork.columns * square_mm:g} x {artwork.rows * square_mm:g} mm"
    asked, fitting = (artwork.unit.format(f"{mm:g}") for mm in (square_mm, math.floor(largest * 10 + 1e-9) / 10))
    return (
        f"the board {board.spec} with {asked} covers {needed} and does not fit on {page}; the largest that fits has "
        f"{fitting}; or choose a larger page"
    )


def _footer(
    board: Board, unit: str, width: float, height: float
) -> tuple[tuple[Rectangle, ...], tuple[Label, ...]]:
    """A ruler with a tick every 10 mm, 100 mm long if there is room, and above it a description of the board."""
    room, foot = width - 2 * MARGIN, height - MARGIN
    length = next(length for length in (100, 50, 20) if length <= room)
    line = Rectangle(MARGIN, foot - _RULER_LINE, length, _RULER_LINE)
    ends = (max(x - _RULER_LINE, 0) for x in range(0, length + 1, 10))
    ticks = (Rectangle(MARGIN + x, foot - 3, _RULER_LINE, 3) for x in ends)
    text = (
        f"{board.spec}{' inner corners' * isinstance(board, Checkerboard)}, {unit}, pinholify {version('pinholify')}; "
        f"printed true to scale, the ruler is {length} mm long"
    )
    size = min(_TEXT_HEIGHT, room / _text_width(text, 1.0))
    return (line, *ticks), (Label(MARGIN, foot - 5, size, text),)


def _text_width(text: str, size: float) -> float:
    from reportlab.pdfbase.pdfmetrics import stringWidth

    return float(stringWidth(text, "Helvetica", size))


# --- from the sheet to a file ---------------------------------------------------------------------


def _write_pdf(sheet: Sheet, path: str | os.PathLike[str]) -> None:
    from reportlab.pdfgen.canvas import Canvas

    page = sheet.width * _POINTS_PER_MM, sheet.height * _POINTS_PER_MM
    with atomic_path(path) as temporary:
        canvas = Canvas(str(temporary), pagesize=page)
        canvas.setTitle(sheet.title)
        canvas.setViewerPreference("PrintScaling", "None")
        canvas.scale(_POINTS_PER_MM, _POINTS_PER_MM)
        for shape in sheet.black:
            if isinstance(shape, Disc):
                canvas.circle(shape.x, sheet.height - shape.y, shape.radius, stroke=0, fill=1)
            else:
                bottom = sheet.height - shape.y - shape.height
                canvas.rect(shape.x, bottom, shape.width, shape.height, stroke=0, fill=1)
        for label in sheet.labels:
            canvas.setFont("Helvetica", label.size)
            canvas.drawString(label.x, sheet.height - label.y, label.text)
        canvas.save()


def _write_svg(sheet: Sheet, path: str | os.PathLike[str]) -> None:
    width, height = f"{sheet.width:g}", f"{sheet.height:g}"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}">',
        f"<title>{escape(sheet.title)}</title>",
        '<rect width="100%" height="100%" fill="white"/>',
        f'<g fill="black" shape-rendering="{_svg_rendering(sheet)}">',
        *(_svg_shape(shape) for shape in sheet.black),
        "</g>",
        '<g font-family="Helvetica, Arial, sans-serif">',
        *(_svg_label(label) for label in sheet.labels),
        "</g>",
        "</svg>",
    ]
    with writing_text(path) as stream:
        stream.writelines(line + "\n" for line in lines)


def _svg_rendering(sheet: Sheet) -> str:
    """Smooth edges for discs; none for rectangles, because smoothing leaves pale seams between neighbours."""
    return "geometricPrecision" if any(isinstance(shape, Disc) for shape in sheet.black) else "crispEdges"


def _svg_shape(r: Rectangle | Disc) -> str:
    if isinstance(r, Disc):
        return f'<circle cx="{r.x:.9g}" cy="{r.y:.9g}" r="{r.radius:.9g}"/>'
    return f'<rect x="{r.x:.9g}" y="{r.y:.9g}" width="{r.width:.9g}" height="{r.height:.9g}"/>'


def _svg_label(label: Label) -> str:
    place = f'x="{label.x:.9g}" y="{label.y:.9g}" font-size="{label.size:.9g}"'
    return f"<text {place}>{escape(label.text)}</text>"


def _write_png(sheet: Sheet, path: str | os.PathLike[str]) -> None:
    from PIL import Image, ImageDraw, ImageFont

    # A whole number of pixels per square, and the resolution to match: all squares are equal and true to scale.
    scale = max(1, round(sheet.square * PNG_DPI / 25.4)) / sheet.square
    width, height = _pixel(sheet.width * scale), _pixel(sheet.height * scale)
    if width * height > _PNG_MAX_PIXELS:
        name = os.fspath(path)
        raise InputError(f"'{name}' would have {width} x {height} pixels; write a PDF or SVG instead")
    image = Image.new("L", (width, height), 255)
    draw = ImageDraw.Draw(image)
    for shape in sheet.black:
        if isinstance(shape, Disc):
            _draw_disc(draw, shape, scale)
        else:
            draw.rectangle(_pixel_box(shape, scale), fill=0)
    for label in sheet.labels:
        font = ImageFont.load_default(size=label.size * scale)
        draw.text((label.x * scale, label.y * scale), label.text, fill=0, font=font, anchor="ls")
    with atomic_path(path) as temporary:
        image.save(temporary, dpi=(scale * 25.4, scale * 25.4))


def _draw_disc(draw: ImageDraw.ImageDraw, disc: Disc, scale: float) -> None:
    """Draw a disc centred on a corner between pixels, so that all discs of a sheet have identical pixels."""
    x, y, radius = _pixel(disc.x * scale), _pixel(disc.y * scale), _pixel(disc.radius * scale)
    draw.ellipse((x - radius, y - radius, x + radius - 1, y + radius - 1), fill=0)


def _pixel_box(r: Rectangle, scale: float) -> tuple[int, int, int, int]:
    """The first and last pixels of ``r``, both inclusive; at least one pixel wide and high."""
    left, top = _pixel(r.x * scale), _pixel(r.y * scale)
    right, bottom = _pixel((r.x + r.width) * scale), _pixel((r.y + r.height) * scale)
    return left, top, max(left, right - 1), max(top, bottom - 1)


def _pixel(value: float) -> int:
    """Round half up, with a tolerance for rounding errors: edges a whole number apart stay so."""
    return math.floor(value + 0.5 + 1e-6)


FORMATS: dict[str, Callable[[Sheet, str | os.PathLike[str]], None]] = {
    ".pdf": _write_pdf,
    ".svg": _write_svg,
    ".png": _write_png,
}
"""Ending → the function that writes a sheet."""
