"""Which part of the board a lattice shows: its corners' ids, or why it cannot be that board.

A lattice of the board's full extent needs nothing more. A smaller one is placed by the visible ends of the board, and
by colour on a board whose colours orient it; where several places remain, the first is taken and marked. The board
ends where its squares meet a white margin; any other end may be that of a hand, a mat or a shadow, and is ignored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import Board
from pinholify.corners import Corners, not_found, sorted_by_id
from pinholify.detection.growth import signs
from pinholify.detection.intensity import Grey
from pinholify.detection.lattice import Lattice, orient, turns
from pinholify.detection.prediction import predict
from pinholify.detection.saddle import sample

MIN_CORNERS_OF_PART = 12
"""Corners below which a part of a board is rejected."""

STEPS = np.arange(0.25, 1.21, 0.05)
"""Distances (squares) beyond the last corners at which grey is read: across the outermost square into the margin."""

OWN_STEPS = 3
"""The first of these, which give the brightness of the outermost squares."""

MARGIN_WIDTH = 0.2
"""Squares behind an edge within which the margin has to be white; the thinnest margin that is recognised."""

EDGE_BLUR = 0.05
"""Squares behind an edge that its blur may darken."""

WHITE_TOLERANCE = 0.3
"""How far the margin's brightness may be from that of the bright squares, as a share of the contrast."""

EDGE_TOLERANCE = 0.1
"""Squares by which the ends of a side's squares may differ; an occluding edge is rarely so parallel."""

FULL_WIDTH_TOLERANCE = 0.12
"""Squares by which the width of the outermost squares may differ from 1."""

MIN_END_SHARE = 0.65
"""Smallest share of a side's squares that have to end in the margin."""

STRAY_SHARE = 0.34
"""An outer line with less than this share of its neighbour's corners may not belong to the board."""


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """Squares from a lattice's first and last column, and its first and last row, to a white margin; 0 without one.

    Only a width of about 1 indicates the board's last corners: squares of another width may be partly hidden.
    """

    left: float
    right: float
    top: float
    bottom: float

    @property
    def whole(self) -> bool:
        """Whether there are margins on all sides, and opposite sides both have full squares or both partial ones."""
        seen = self.left and self.right and self.top and self.bottom
        return bool(seen) and _full(self.left) == _full(self.right) and _full(self.top) == _full(self.bottom)


def place(grey: Grey, lattice: Lattice, board: Board, *, name: str, mirrored: bool) -> Corners:
    """The corners of ``lattice`` with their ids on ``board``, or the reason why it is not that board.

    ``grey`` (height, width) is used to see whether the board ends beside the lattice.
    """
    lattice = within_margins(grey, without_stray_lines(lattice, board).at_origin())
    size = (board.columns, board.rows)
    ways = [way.at_origin() for way in turns(lattice, mirrored=mirrored)]
    complete = [way for way in ways if way.extent == size]
    if complete:
        chosen, assumed = orient(complete, board)
        return _corners(chosen, board, name, assumed=assumed, ambiguous=False)
    fitting = [way for way in ways if way.extent[0] <= size[0] and way.extent[1] <= size[1]]
    if not fitting:
        reason = f"a board of at least {_size(lattice)} corners is larger than {board.spec}"
        return not_found(name, reason, larger_board=True)
    if len(lattice) < MIN_CORNERS_OF_PART:
        return not_found(name, f"only {len(lattice)} corners of a board were found")
    return _part(grey, fitting, board, name)


def _part(grey: Grey, fitting: list[Lattice], board: Board, name: str) -> Corners:
    """The corners of a lattice smaller than ``board``, which may have the numberings ``fitting``."""
    lattice = fitting[0]
    seen = [ends(grey, way) for way in fitting]
    placed = [places for way, sides in zip(fitting, seen, strict=True) if (places := _shifts(way, board, sides))]
    if seen[0].whole or not placed:
        return not_found(name, f"the board has {_size(lattice)} inner corners, not {board.spec}")
    ambiguous = sum(len(places) for places in placed) > _symmetries(board)
    if ambiguous and 2 * len(lattice) < board.columns * board.rows:
        return not_found(
            name,
            f"only {len(lattice)} of {board.columns * board.rows} corners are visible, and which ones cannot be "
            "determined",
        )
    chosen, _ = orient([places[0] for places in placed], board)
    return _corners(chosen, board, name, assumed=ambiguous or not board.orientable, ambiguous=ambiguous)


def without_stray_lines(lattice: Lattice, board: Board) -> Lattice:
    """``lattice`` without sparse outer lines, as long as it is too large for ``board`` in either orientation."""
    longest, shortest = max(board.columns, board.rows), min(board.columns, board.rows)
    while max(lattice.extent) > longest or min(lattice.extent) > shortest:
        too_long = max(lattice.extent) > longest
        axis = int(np.argmax(lattice.extent) if too_long else np.argmin(lattice.extent))
        line = lattice.index[:, axis]
        counts = np.bincount(line - line.min())
        last_is_sparser = counts[-1] < counts[0]
        outer, next_to_it = (counts[-1], counts[-2]) if last_is_sparser else (counts[0], counts[1])
        if outer >= STRAY_SHARE * next_to_it:
            break
        lattice = lattice.select(line != (line.max() if last_is_sparser else line.min()))
    return lattice


def within_margins(grey: Grey, lattice: Lattice) -> Lattice:
    """``lattice``, which starts at (0, 0), without single corners beyond the board's ends."""
    for axis in (0, 1):
        for last in (False, True):
            line = lattice.index[:, axis]
            outer = line == (line.max() if last else 0)
            if outer.sum() == 1:
                inner = lattice.select(~outer).at_origin()
                lattice = inner if _full(_end(grey, inner, axis, last=last)) else lattice
    return lattice


def ends(grey: Grey, lattice: Lattice) -> Ends:
    """Where the board ends on each side of ``lattice``, which starts at (0, 0)."""
    left, right, top, bottom = (_end(grey, lattice, axis, last=last) for axis in (0, 1) for last in (False, True))
    return Ends(left, right, top, bottom)


def _end(grey: Grey, lattice: Lattice, axis: int, *, last: bool) -> float:
    """Squares from the first or ``last`` column (``axis`` 0) or row to a white margin; 0 without one.

    Most of the squares outside that line have to alternate and to end in the margin, so that a shadow, a mat or a hand
    is not taken for the board's end.
    """
    line = _pairs_of_line(lattice, axis, last=last)
    if len(line) < 2:
        return 0.0
    outward, along = np.eye(2, dtype=np.int64)[[axis, 1 - axis]]
    outward = outward if last else -outward
    # A square is named by its corner of the smallest column and row.
    bright = signs(line + np.minimum(outward, 0), lattice.phase) > 0
    level, seen = _across(grey, lattice, line + 0.5 * along, outward)
    line, bright, level = line[seen], bright[seen], level[seen]
    if bright.all() or not bright.any():
        return 0.0
    end, good = _margin(_relative(level, bright, line @ along), bright)
    side = lattice.extent[1 - axis] - 1
    enough = MIN_END_SHARE * max(len(line), side / 2 if _full(end) else side)
    return end if good[bright].any() and good[~bright].any() and good.sum() >= enough else 0.0


def _pairs_of_line(lattice: Lattice, axis: int, *, last: bool) -> Ints:
    """The corners (m, 2), in order, of the first or ``last`` column (``axis`` 0) or row that have a next one in it."""
    line = lattice.index[:, axis]
    outer = lattice.index[line == (line.max() if last else line.min())]
    along = outer[:, 1 - axis]
    order = np.argsort(along)
    return np.asarray(outer[order][np.isin(along[order] + 1, along)])


def _across(grey: Grey, lattice: Lattice, middle: Floats, outward: Ints) -> tuple[Floats, Bools]:
    """Grey (m, steps) at STEPS ``outward`` from the ``middle`` (m, 2) of squares' sides, and which (m,) are visible."""
    steps = middle[:, None] + STEPS[:, None] * outward
    places = predict(lattice.index, lattice.uv, steps.reshape(-1, 2)).uv
    size = np.array([grey.shape[1], grey.shape[0]]) - 1
    seen = ((places > 1) & (places < size - 1)).reshape(len(middle), -1)
    values = sample(grey, np.clip(places, 1, size - 1)).reshape(steps.shape[:2])
    return np.asarray(values), np.asarray(seen.all(axis=1))


def _relative(level: Floats, bright: Bools, at: Ints) -> Floats:
    """``level`` (m, steps) scaled from 0, dark, to 1, bright, as the outer squares near ``at`` (m,) are."""
    own = level[:, :OWN_STEPS].mean(axis=1)
    high, low = (np.interp(at, at[some], own[some]) for some in (bright, ~bright))
    return np.asarray((level - low[:, None]) / np.maximum(high - low, 1e-6)[:, None])


def _margin(level: Floats, bright: Bools) -> tuple[float, Bools]:
    """Squares until the dark outer squares end, and which squares (m,) end there in a white margin.

    ``level`` (m, steps) is 0 in the dark and 1 in the ``bright`` squares.
    """
    edge = STEPS[(level[~bright] > 0.5).argmax(axis=1)] - (STEPS[1] - STEPS[0]) / 2
    end = float(np.median(edge))
    white = np.asarray(np.abs(level - 1) < WHITE_TOLERANCE)
    behind = (end < STEPS) & (end + MARGIN_WIDTH > STEPS)
    good = np.array(white[:, end + EDGE_BLUR > STEPS].all(axis=1), dtype=bool)
    good[~bright] = (np.abs(edge - end) < EDGE_TOLERANCE) & white[~bright][:, behind].any(axis=1)
    return end, good


def _shifts(way: Lattice, board: Board, seen: Ends) -> list[Lattice]:
    """``way`` at each place on ``board`` that its colours and the visible ends ``seen`` allow."""
    columns, rows = way.extent
    across = _offsets(board.columns - columns, _full(seen.left), _full(seen.right))
    down = _offsets(board.rows - rows, _full(seen.top), _full(seen.bottom))
    shifted = [way.shifted((dx, dy)) for dx in across for dy in down]
    if board.orientable:
        return [lattice for lattice in shifted if lattice.phase < 0]
    return shifted


def _offsets(room: int, at_start: bool, at_end: bool) -> list[int]:
    if at_start and at_end:
        return [0] if room == 0 else []
    return [0] if at_start else [room] if at_end else list(range(room + 1))


def _full(width: float) -> bool:
    """Whether ``width`` is that of a whole square."""
    return abs(width - 1) < FULL_WIDTH_TOLERANCE


def _symmetries(board: Board) -> int:
    """Number of orientations of ``board`` that look the same in an image of all of it."""
    if board.orientable:
        return 1
    return 4 if board.columns == board.rows and board.columns % 2 == 0 else 2


def _size(lattice: Lattice) -> str:
    columns, rows = sorted(lattice.extent, reverse=True)
    return f"{columns}x{rows}"


def _corners(lattice: Lattice, board: Board, name: str, *, assumed: bool, ambiguous: bool) -> Corners:
    corners = Corners(
        name,
        lattice.ids(board),
        lattice.uv,
        lattice.weights,
        orientation_assumed=assumed,
        ambiguous_offset=ambiguous,
    )
    return sorted_by_id(corners)
