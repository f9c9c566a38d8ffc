"""Which part of the board a lattice shows: its corners' ids, or why it cannot be that board.

A lattice of the board's full extent needs nothing more. A smaller one is placed by the board's ends where it
sees them, and by colour on a board whose colours orient it; where several places remain, the first is taken
and marked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints
from pinholify.board import Board
from pinholify.corners import Corners, not_found
from pinholify.detection.growth import signs
from pinholify.detection.intensity import Grey
from pinholify.detection.lattice import Lattice, orient, turns
from pinholify.detection.prediction import predict
from pinholify.detection.saddle import sample

FEWEST_OF_PART = 12
LARGER = "is larger than"
"""Corners below which a part of a board is not believed."""

MARGIN = 1.2
"""Where the margin is looked for, in squares beyond the last corners; the outermost squares may be cut short.
"""

STRAY = 0.34
"""An outer line with less than this fraction of its neighbour's corners may be none of the board's."""


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """Whether the board is seen to end beyond a lattice's first and last column, and its first and last row.
    """

    left: bool
    right: bool
    top: bool
    bottom: bool


def place(grey: Grey, lattice: Lattice, board: Board, *, name: str, mirrored: bool) -> Corners:
    """The corners of ``lattice`` with their ids on ``board``; without corners and with a reason where it is
    another.

    ``grey`` (height, width) shows whether the board ends beside the lattice.
    """
    lattice = without_stray_lines(lattice, board).at_origin()
    size = (board.columns, board.rows)
    ways = [way.at_origin() for way in turns(lattice, mirrored=mirrored)]
    complete = [way for way in ways if way.extent == size]
    if complete:
        chosen, assumed = orient(complete, board)
        return _corners(chosen, board, name, assumed=assumed, ambiguous=False)
    fitting = [way for way in ways if way.extent[0] <= size[0] and way.extent[1] <= size[1]]
    if not fitting:
        return not_found(name, f"a board of at least {_size(lattice)} corners {LARGER} {board.spec}")
    if len(lattice) < FEWEST_OF_PART:
        return not_found(name, f"only {len(lattice)} corners of a board were found")
    placed = [places for way in fitting if (places := _shifts(way, board, ends(grey, way)))]
    if not placed:
        return not_found(name, f"the board has {_size(lattice)} inner corners, not {board.spec}")
    ambiguous = sum(len(places) for places in placed) > _symmetries(board)
    if ambiguous and 2 * len(lattice) < board.columns * board.rows:
        return not_found(
            name,
            f"only {len(lattice)} of {board.columns * board.rows} corners are seen, and which ones cannot be told",
        )
    chosen, _ = orient([places[0] for places in placed], board)
    return _corners(chosen, board, name, assumed=ambiguous or not board.orientable, ambiguous=ambiguous)


def without_stray_lines(lattice: Lattice, board: Board) -> Lattice:
    """``lattice`` without sparse outer lines, as long as it is larger than ``board`` whichever way it is
    turned.
    """
    longest, shortest = max(board.columns, board.rows), min(board.columns, board.rows)
    while max(lattice.extent) > longest or min(lattice.extent) > shortest:
        too_long = max(lattice.extent) > longest
        axis = int(np.argmax(lattice.extent) if too_long else np.argmin(lattice.extent))
        line = lattice.index[:, axis]
        counts = np.bincount(line - line.min())
        last_is_sparser = counts[-1] < counts[0]
        outer, next_to_it = (counts[-1], counts[-2]) if last_is_sparser else (counts[0], counts[1])
        if outer >= STRAY * next_to_it:
            break
        lattice = lattice.select(line != (line.max() if last_is_sparser else line.min()))
    return lattice


def ends(grey: Grey, lattice: Lattice) -> Ends:
    """On which sides of ``lattice``, which starts at (0, 0), the board is seen to end."""
    columns, rows = lattice.extent
    x, y = np.array([1, 0]), np.array([0, 1])
    return Ends(
        left=_ends(grey, lattice, np.array([0, 0]), -x, y, rows),
        right=_ends(grey, lattice, np.array([columns - 1, 0]), x, y, rows),
        top=_ends(grey, lattice, np.array([0, 0]), -y, x, columns),
        bottom=_ends(grey, lattice, np.array([0, rows - 1]), y, x, columns),
    )


def _ends(grey: Grey, lattice: Lattice, first: Ints, outward: Ints, along: Ints, count: int) -> bool:
    """Whether squares alternate just outside the line from ``first`` on, and then run into one margin.

    The margin is as bright as the bright squares, or as dark as the dark ones. So a finger over the board's
    rest, or squares lost in a glare, do not pass for its end.
    """
    known = {(int(i), int(j)) for i, j in lattice.index}
    starts = [first + k * along for k in range(count - 1)]
    starts = [p for p in starts if tuple(p) in known and tuple(p + along) in known]
    if len(starts) < 2:
        return False
    line = np.array(starts)
    # A square is named by its corner of the smallest column and row.
    outer, inner = line + np.minimum(outward, 0), line - np.maximum(outward, 0)
    colour = signs(outer, lattice.phase)
    inside = _levels(grey, lattice, line - 0.3 * outward, along, signs(inner, lattice.phase))
    bright, dark = _levels(grey, lattice, line + 0.3 * outward, along, colour)
    margin = _levels(grey, lattice, line + MARGIN * outward, along, colour)
    contrast = inside[0] - inside[1]
    if not (contrast > 0 and bright - dark > 0.5 * contrast):  # Nor where too few squares are seen: nan.
        return False
    return min(max(abs(seen - level) for seen in margin) for level in (bright, dark)) < 0.35 * (bright - dark)


def _levels(grey: Grey, lattice: Lattice, start: Floats, along: Ints, colour: Floats) -> tuple[float, float]:
    """Mean grey half a step ``along`` from ``start``, where ``colour`` is +1 and where it is -1.

    Both are nan where the image does not show some of each.
    """
    places = predict(lattice.index, lattice.uv, start + 0.5 * along).uv
    size = np.array([grey.shape[1], grey.shape[0]]) - 1
    seen = ((places > 1) & (places < size - 1)).all(axis=1)
    if abs(colour[seen].sum()) == seen.sum():
        return float("nan"), float("nan")
    values = sample(grey, places[seen])
    return float(values[colour[seen] > 0].mean()), float(values[colour[seen] < 0].mean())


def _shifts(way: Lattice, board: Board, seen: Ends) -> list[Lattice]:
    """``way`` at each place on ``board`` where the ends that it sees, and its colours, allow it to be."""
    columns, rows = way.extent
    across = _offsets(board.columns - columns, seen.left, seen.right)
    down = _offsets(board.rows - rows, seen.top, seen.bottom)
    shifted = [way.shifted((dx, dy)) for dx in across for dy in down]
    if board.orientable:
        return [lattice for lattice in shifted if lattice.phase < 0]
    return shifted


def _offsets(room: int, at_start: bool, at_end: bool) -> list[int]:
    if at_start and at_end:
        return [0] if room == 0 else []
    return [0] if at_start else [room] if at_end else list(range(room + 1))


def _symmetries(board: Board) -> int:
    """Ways to turn ``board`` that no picture of all of it can tell apart."""
    if board.orientable:
        return 1
    return 4 if board.columns == board.rows and board.columns % 2 == 0 else 2


def _size(lattice: Lattice) -> str:
    columns, rows = sorted(lattice.extent, reverse=True)
    return f"{columns}x{rows}"


def _corners(lattice: Lattice, board: Board, name: str, *, assumed: bool, ambiguous: bool) -> Corners:
    ids = lattice.ids(board)
    order = np.argsort(ids)
    return Corners(name, ids[order], lattice.uv[order], lattice.weights[order], "", assumed, ambiguous)
