"""Which photographs are worth having: how a board stands in the picture, what is missing, where to hold it next.

The four bars X, Y, size and skew, and what counts as full, are those of ROS's cameracalibrator, which people know; two
measures of perspective beside them tell boards apart that are tilted the other way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from pinholify.arrays import Floats
from pinholify.board import Board, outline, size
from pinholify.corners import Corners
from pinholify.geometry import apply_homography, estimate_homography

FULL = {"x": 0.7, "y": 0.7, "size": 0.4, "skew": 0.5}
"""How far the boards must reach in each measure."""

FROM_ZERO = frozenset(["size", "skew"])  # a large board, or a tilted one, needs no small or straight one beside it
NEW = 0.2  # sum of differences of all measures from which on a posture is new
SHARP = 2.0  # px: standard deviation of the blur of a sharp picture at most, or
SHARP_SHARE = 0.06  # of a square
STILL = 0.02  # of a square: largest movement between two pictures at which the board is held still
BARS_FULL = 0.999
CONTENT_BOARDS = 10
FOCAL_KNOWN = 0.005  # relative standard deviation of f of a camera to be content with


@dataclass(frozen=True, slots=True)
class Posture:
    """How a board stands in the picture: place and size 0 … 1, skew 0 … 1, perspective along both axes −1 … 1."""

    x: float
    y: float
    size: float
    skew: float
    perspective_x: float
    perspective_y: float

    def difference(self, other: Posture) -> float:
        """Sum of the differences of all measures."""
        return float(np.abs(np.subtract(astuple(self), astuple(other))).sum())


def posture(view: Corners, board: Board, image_size: tuple[int, int]) -> Posture:
    """The posture of the board of ``view``, found from the outline that its corners span."""
    ends = outer_corners(view, board)
    sides = np.linalg.norm(np.roll(ends, -1, axis=0) - ends, axis=1)  # top, right, bottom, left
    width, height = image_size
    area = _area(ends)
    border = np.sqrt(area)
    middle = ends.mean(axis=0)
    return Posture(
        _share(middle[0] - border / 2, width - border),
        _share(middle[1] - border / 2, height - border),
        float(np.clip(np.sqrt(area / (width * height)), 0, 1)),
        min(1.0, 2.0 * abs(np.pi / 2 - _angle(ends))),
        float((sides[1] - sides[3]) / (sides[1] + sides[3])),
        float((sides[2] - sides[0]) / (sides[2] + sides[0])),
    )


def outer_corners(view: Corners, board: Board) -> Floats:
    """Where the four outermost corners of the whole board would be, (4, 2) px, clockwise from the first."""
    if len(view) == size(board):
        ends = [0, board.columns - 1, len(view) - 1, len(view) - board.columns]
        return view.uv[np.argsort(view.ids)[ends]]
    (left, top), (right, bottom) = outline(board)
    ends_on_board = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    return apply_homography(estimate_homography(view.lattice(board), view.uv), ends_on_board)


def bars(postures: Sequence[Posture]) -> dict[str, float]:
    """How far each of X, Y, size and skew has been covered, 0 … 1."""
    if not postures:
        return dict.fromkeys(FULL, 0.0)
    covered = {}
    for name, full in FULL.items():
        values = [getattr(p, name) for p in postures]
        low = 0.0 if name in FROM_ZERO else min(values)
        covered[name] = min(1.0, (max(values) - low) / full)
    return covered


@dataclass(frozen=True, slots=True)
class Choice:
    """Whether to keep a picture, and what to tell the person who holds the board."""

    keep: bool
    hint: str


def choose(
    view: Corners,
    board: Board,
    image_size: tuple[int, int],
    blur_px: float,
    kept: Sequence[Posture],
    previous: Corners | None,
) -> Choice:
    """Whether a picture of ``view`` is sharp, still against the ``previous`` one, and unlike those ``kept``.

    ``blur_px`` is the standard deviation of its blur. Without a ``previous`` picture stillness is not asked for.
    """
    if not view.found:
        return Choice(False, "No board in sight")
    square = _square_px(view, board)
    if previous is not None and _movement(view, previous) > max(1.0, STILL * square):
        return Choice(False, "Hold the board still")
    if blur_px > max(SHARP, SHARP_SHARE * square):
        return Choice(False, "The picture is not sharp: more light, or hold still")
    here = posture(view, board, image_size)
    if min((here.difference(other) for other in kept), default=np.inf) < NEW:
        return Choice(False, "You have this one: move or tilt the board")
    return Choice(True, "Taken")


def advice(covered: dict[str, float], postures: Sequence[Posture]) -> str:
    """One sentence on what the next picture should show, from the bars alone."""
    if not postures:
        return "Hold the board so that it nearly fills the picture."
    lowest = min(covered, key=lambda name: covered[name])
    if covered[lowest] >= BARS_FULL:
        return "All bars are full: a few more boards in the corners of the picture still help."
    if lowest == "size":
        return "Come closer: one board should nearly fill the picture."
    if lowest == "skew":
        return "Tilt the board: turn one side towards the camera, then another."
    values = [getattr(p, lowest) for p in postures]
    low_side, high_side = ("left", "right") if lowest == "x" else ("top", "bottom")
    return f"Hold the board at the {low_side if min(values) > 1 - max(values) else high_side} of the picture."


def content(result: dict[str, Any]) -> bool:
    """Whether a live calibration may end with ``result``: judged good, f known well, from enough boards."""
    known = result["f_px_std"] is not None and result["f_px_std"] < FOCAL_KNOWN * result["f_px"]
    return known and result["level"] == "good" and len(result["photographs"]) >= CONTENT_BOARDS


def _movement(view: Corners, previous: Corners) -> float:
    """Median distance in px that corners moved since the ``previous`` picture; infinite where they share none."""
    _, here, there = np.intersect1d(view.ids, previous.ids, return_indices=True)
    if not len(here):
        return float("inf")
    return float(np.median(np.linalg.norm(view.uv[here] - previous.uv[there], axis=1)))


def _square_px(view: Corners, board: Board) -> float:
    """Typical distance in px of neighbouring corners."""
    order = np.argsort(view.ids)
    beside = np.diff(view.ids[order]) == 1
    steps = np.linalg.norm(np.diff(view.uv[order], axis=0), axis=1)[beside]
    return float(np.median(steps)) if len(steps) else 0.0


def _area(ends: Floats) -> float:
    x, y = ends.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def _angle(ends: Floats) -> float:
    """The angle at the second corner, rad."""
    a, b = ends[0] - ends[1], ends[2] - ends[1]
    return float(np.arccos(np.clip(a @ b / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-9), -1, 1)))


def _share(value: float, whole: float) -> float:
    return float(np.clip(value / max(whole, 1e-9), 0, 1))
