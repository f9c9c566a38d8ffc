"""Corner tables (``.vnl``): corners of many images as plain text, in the format of mrcal.

A header ``# filename x y level``, then one line per corner: name, x, y, level, separated by blanks, with all ids of the
board in order. An unseen corner is ``name - - -``; an image without a board is exactly one such line. Lines that begin
with ``#`` are comments; two of them have a meaning here: ``## ambiguous-offset name`` and ``## orientation-assumed
name``. A last column called ``weight`` holds weights; under any other name it is ignored. A corner whose weight is
``-``, zero or negative is unseen. The table contains neither the board nor the image size.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TextIO

import numpy as np

from pinholify.board import Board, size
from pinholify.corners import Corners, CornerSet, not_found
from pinholify.errors import CornerTableError
from pinholify.io.files import TextFile, reading_text, source_name, writing_text

AMBIGUOUS_OFFSET = "ambiguous-offset"
ORIENTATION_ASSUMED = "orientation-assumed"

_UNSEEN = (math.nan, math.nan, math.nan)
_REASON = "the corner table lists no corners for it"


def read_corner_table(source: TextFile, *, board: Board, image_size: tuple[int, int]) -> CornerSet:
    """Read the corners in the table ``source``, a path or an open text stream, in the order of the table.

    ``board`` and ``image_size``, (width, height) in px, are not part of the table. Raises CornerTableError, with the
    line number, for anything that violates the format.
    """
    table = _Table(source_name(source))
    with reading_text(source, CornerTableError) as stream:
        table.read(stream)
    if not table.images:
        needed = "one line per corner is needed: filename x y level"
        raise CornerTableError(f"'{table.name}' holds no corners; {needed}")
    return CornerSet(board, image_size, tuple(table.view(image, board) for image in table.images))


def write_corner_table(target: TextFile, corners: CornerSet) -> None:
    """Write ``corners`` to ``target``, a path or an open text stream; reading it returns identical numbers.

    The last column is ``weight`` if any weight differs from one, and otherwise ``level`` (always zero: full
    resolution). Raises CornerTableError for a name with blanks, and OutputError if the file cannot be written.
    """
    lines = list(_lines(corners))
    with writing_text(target) as stream:
        stream.writelines(lines)


@dataclass(slots=True)
class _Image:
    """The lines of one image: the number of the first, and x, y, weight of each (nan if unseen)."""

    line: int
    rows: list[tuple[float, float, float]] = field(default_factory=list)


@dataclass(slots=True)
class _Table:
    """The state of reading a table."""

    name: str
    weighted: bool = False
    images: dict[str, _Image] = field(default_factory=dict)
    notes: set[tuple[str, ...]] = field(default_factory=set)

    def read(self, stream: TextIO) -> None:
        for number, line in enumerate(stream, start=1):
            fields = line.split()
            if line.lstrip().startswith("#"):
                self._comment(number, line.strip())
            elif fields:
                row = self._row(number, fields)
                self.images.setdefault(fields[0], _Image(number)).rows.append(row)

    def _comment(self, number: int, comment: str) -> None:
        words = comment.lstrip("#").split()
        if comment.startswith("##"):
            self.notes.add(tuple(words))
        elif {"filename", "x", "y"} <= set(words):
            if words[:3] != ["filename", "x", "y"]:
                columns = " ".join(words)
                raise self._error(number, f"the columns are '{columns}' where filename x y level is needed")
            self.weighted = words[3:] == ["weight"]

    def _row(self, number: int, fields: list[str]) -> tuple[float, float, float]:
        if len(fields) not in (3, 4):
            needed = "filename, x, y and level are needed, without blanks in the name"
            raise self._error(number, f"{len(fields)} words were found where {needed}")
        x, y = fields[1:3]
        weight = fields[3] if self.weighted and len(fields) == 4 else "1"
        if x == y == "-" or weight == "-":
            return _UNSEEN
        values = self._number(number, x), self._number(number, y), self._number(number, weight)
        return values if values[2] > 0 else _UNSEEN

    def _number(self, number: int, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self._error(number, f"'{text[:40]}' was found where a finite number or '-' is needed")
        return value

    def view(self, name: str, board: Board) -> Corners:
        """The corners of image ``name``; raises CornerTableError if their number is not that of ``board``."""
        image, needed = self.images[name], size(board)
        rows = np.array(image.rows)
        seen = np.isfinite(rows[:, 0])
        if len(rows) != needed and (len(rows) != 1 or seen.any()):
            problem = f"'{name}' has {len(rows)} lines where a {board.spec} board needs {needed}"
            advice = "one per corner, or a single '- - -' for no board; check the size of the board"
            raise self._error(image.line, f"{problem}, {advice}")
        if not seen.any():
            return not_found(name, _REASON)
        return Corners(name, np.flatnonzero(seen), rows[seen, :2], rows[seen, 2],
                       orientation_assumed=(ORIENTATION_ASSUMED, name) in self.notes,
                       ambiguous_offset=(AMBIGUOUS_OFFSET, name) in self.notes)

    def _error(self, number: int, problem: str) -> CornerTableError:
        return CornerTableError(f"'{self.name}', line {number}: {problem}")


def _lines(corners: CornerSet) -> Iterator[str]:
    weighted = any((view.weights != 1).any() for view in corners.views)
    yield f"# filename x y {'weight' if weighted else 'level'}\n"
    for view in corners.views:
        check_name(view.name)
        yield from _notes(view)
        yield from _rows(view, size(corners.board), weighted)


def _notes(view: Corners) -> Iterable[str]:
    if view.ambiguous_offset:
        yield f"## {AMBIGUOUS_OFFSET} {view.name}\n"
    if view.orientation_assumed:
        yield f"## {ORIENTATION_ASSUMED} {view.name}\n"


def _rows(view: Corners, count: int, weighted: bool) -> Iterable[str]:
    usable = (view.weights > 0) & np.isfinite(view.weights)
    if not usable.any():
        yield f"{view.name} - - -\n"
        return
    texts = [f"{view.name} - - -\n"] * count
    rows = zip(view.ids[usable], view.uv[usable].tolist(), view.weights[usable].tolist(), strict=True)
    for corner, (x, y), weight in rows:
        texts[corner] = f"{view.name} {x!r} {y!r} {weight if weighted else 0!r}\n"
    yield from texts


def check_name(name: str) -> None:
    """Raise CornerTableError for an image name that is not allowed in a corner table."""
    if name.split() != [name] or name.startswith("#"):
        raise CornerTableError(
            f"'{name}' is not allowed in a corner table, where names have no blanks and do not begin with '#'; "
            "rename the image"
        )
