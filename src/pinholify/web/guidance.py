"""Guidance for taking photographs: the posture of a board in the picture, what is missing, where to hold it next.

The four bars X, Y, size and skew and the values that count as full are those of ROS's cameracalibrator. Two additional
measures of perspective distinguish boards that are tilted in opposite directions.
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
"""The range of each measure that the boards must cover."""

FROM_ZERO = frozenset(["size", "skew"])  # the range starts at zero: no small or untilted board is needed
NEW = 0.2  # sum of differences of all measures from which a posture is new
SHARP = 2.0  # px: largest standard deviation of the blur of a sharp picture, or
SHARP_SHARE = 0.06  # the same as a fraction of a square
STILL = 0.02  # largest movement between two pictures of a still board, as a fraction of a square
BARS_FULL = 0.999
ENOUGH_BOARDS = 10
FOCAL_KNOWN = 0.005  # relative standard deviation of f at which a live calibration may end


@dataclass(frozen=True, slots=True)
class Posture:
    """The posture of a board in the picture: place, size and skew 0 … 1, perspective along both axes −1 … 1."""

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
    """The posture of the board of ``view``, computed from its outline."""
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
    """The four outermost corners (4, 2) px of the whole board, clockwise from the first, extrapolated if not found."""
    if len(view) == size(board):
        ends = [0, board.columns - 1, len(view) - 1, len(view) - board.columns]
        return view.uv[np.argsort(view.ids)[ends]]
    (left, top), (right, bottom) = outline(board)
    ends_on_board = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    return apply_homography(estimate_homography(view.lattice(board), view.uv), ends_on_board)


def bars(postures: Sequence[Posture]) -> dict[str, float]:
    """The share 0 … 1 of the required range of X, Y, size and skew that ``postures`` cover."""
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
    """Whether to keep a picture, and a hint for the person who holds the board."""

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
    """Keep a picture of ``view`` if it is sharp, unmoved since the ``previous`` one, and unlike those ``kept``.

    ``blur_px`` is the standard deviation of its blur. Without a ``previous`` picture, movement is not tested.
    """
    if not view.found:
        return Choice(False, "No board in view")
    square = _square_px(view)
    if previous is not None and _movement(view, previous) > max(1.0, STILL * square):
        return Choice(False, "Hold the board still")
    if blur_px > max(SHARP, SHARP_SHARE * square):
        return Choice(False, "The picture is not sharp: use more light or hold still")
    here = posture(view, board, image_size)
    if min((here.difference(other) for other in kept), default=np.inf) < NEW:
        return Choice(False, "This view is already taken: move or tilt the board")
    return Choice(True, "Taken")


def advice(covered: dict[str, float], postures: Sequence[Posture]) -> str:
    """One sentence on what the next picture should show, from the bars alone."""
    if not postures:
        return "Hold the board so that it nearly fills the picture."
    lowest = min(covered, key=lambda name: covered[name])
    if covered[lowest] >= BARS_FULL:
        return "All bars are full; a few more boards in the corners of the picture still help."
    if lowest == "size":
        return "Move closer: one board should nearly fill the picture."
    if lowest == "skew":
        return "Tilt the board: turn one side towards the camera, then another."
    values = [getattr(p, lowest) for p in postures]
    low_side, high_side = ("left", "right") if lowest == "x" else ("top", "bottom")
    return f"Hold the board at the {low_side if min(values) > 1 - max(values) else high_side} of the picture."


def good_enough(result: dict[str, Any]) -> bool:
    """Whether a live calibration may end with ``result``: judged good, with f known well, from enough boards."""
    known = result["f_px_std"] is not None and result["f_px_std"] < FOCAL_KNOWN * result["f_px"]
    return known and result["level"] == "good" and len(result["photographs"]) >= ENOUGH_BOARDS


def _movement(view: Corners, previous: Corners) -> float:
    """Median distance in px that corners moved since the ``previous`` picture; infinite if it has none of them."""
    _, here, there = np.intersect1d(view.ids, previous.ids, return_indices=True)
    if not len(here):
        return float("inf")
    return float(np.median(np.linalg.norm(view.uv[here] - previous.uv[there], axis=1)))


def _square_px(view: Corners) -> float:
    """Median distance in px of neighbouring corners."""
    order = np.argsort(view.ids)
    adjacent = np.diff(view.ids[order]) == 1
    steps = np.linalg.norm(np.diff(view.uv[order], axis=0), axis=1)[adjacent]
    return float(np.median(steps)) if len(steps) else 0.0


def _area(ends: Floats) -> float:
    x, y = ends.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def _angle(ends: Floats) -> float:
    """The angle at the second corner, in radians."""
    a, b = ends[0] - ends[1], ends[2] - ends[1]
    return float(np.arccos(np.clip(a @ b / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-9), -1, 1)))


def _share(value: float, whole: float) -> float:
    return float(np.clip(value / max(whole, 1e-9), 0, 1))
