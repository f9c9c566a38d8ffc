"""AprilTags in an image, and whether they are arranged as on the requested board or on another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import FAMILIES, AprilGrid
from pinholify.detection.intensity import Grey, stretched
from pinholify.detection.markers import Markers, read_markers

BORDERS = (2, 1)
"""Black cells around a tag's code: first Kalibr's number, then AprilTag's own."""

ENOUGH_TAGS = 4
"""Tags needed to recognise another board."""

ENOUGH_SHARE = 0.3
"""Share of a board's tags (at least ENOUGH_TAGS) at which no further rendering is tried: the lattice finds the rest."""

SMOOTHING_PX = 1.2
"""Standard deviation (px) of the blur that makes a noisy image's tags legible."""

LARGE_IMAGE_PIXELS = 4_000_000
"""Images of this many pixels or more are also read at half size, smaller ones at twice their size."""

AGREEMENT = 0.25
"""Two tags agree if each predicts the other's centre to within this share of their distance."""

NEAR_TAGS = 2
"""Distance, in tags, within which tags are compared; farther only where none is nearer."""

MAX_TAGS_ACROSS = 30
"""Largest number of tags across that is tried where the tags do not match the requested board."""


@dataclass(frozen=True, slots=True, eq=False)
class Tags:
    """Tags of one family: ``number`` (n,), and ``uv`` (n, 2, 2, 2) px of their corners.

    ``uv[k, j, i]`` is the corner i to the right and j down. ``border`` is the number of black cells around the code.
    """

    number: Ints
    uv: Floats
    border: int

    def __len__(self) -> int:
        """Number of tags."""
        return len(self.number)

    def select(self, keep: Bools) -> Tags:
        """The tags where ``keep`` (n,) is true."""
        return replace(self, number=self.number[keep], uv=self.uv[keep])

    def corners(self, board: AprilGrid) -> tuple[Ints, Floats]:
        """Lattice indices (4n, 2) of all corners on ``board`` and their pixels (4n, 2)."""
        end = np.array([[[0, 0], [1, 0]], [[0, 1], [1, 1]]])
        cell = _cells(self, board.across) + np.array([0, board.down - 1])
        index = 2 * cell[:, None, None] + end
        return index.reshape(-1, 2), self.uv.reshape(-1, 2)


def find_tags(grey: Grey, board: AprilGrid) -> Tags:
    """The tags of the family of ``board``, from the rendering of ``grey`` in which most agree; perhaps none."""
    enough = max(ENOUGH_TAGS, ENOUGH_SHARE * board.across * board.down)
    best, most = Tags(np.empty(0, dtype=np.int64), np.empty((0, 2, 2, 2)), BORDERS[0]), 0
    for factor, picture in _pictures(grey):
        for border in BORDERS:
            tags = _tags(read_markers(picture, [FAMILIES[board.family]], border=border)[0], border, factor)
            agreeing = int(agreeing_tags(tags, board).sum())
            if agreeing > most:
                best, most = tags, agreeing
            if most >= enough:
                return best
    return best


def _pictures(grey: Grey) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Renderings to read tags in, each with its scale: the image itself, smoothed against noise, and resized."""
    yield 1.0, stretched(grey)
    yield 1.0, stretched(cv2.GaussianBlur(grey, (0, 0), SMOOTHING_PX).astype(np.float32))
    factor = 2.0 if grey.size < LARGE_IMAGE_PIXELS else 0.5
    how = cv2.INTER_CUBIC if factor > 1 else cv2.INTER_AREA
    yield factor, stretched(cv2.resize(grey, None, fx=factor, fy=factor, interpolation=how).astype(np.float32))


def _tags(markers: Markers, border: int, factor: float) -> Tags:
    """``markers`` of a picture ``factor`` times as large as the image."""
    uv = (markers.quads + 0.5) / factor - 0.5
    # OpenCV goes clockwise from what is its top left and Kalibr's bottom right.
    return Tags(markers.number, uv[:, [2, 3, 1, 0]].reshape(-1, 2, 2, 2), border)


# --- arrangement ------------------------------------------------------------------------------------


def agreeing_tags(tags: Tags, board: AprilGrid) -> Bools:
    """Which tags (n,) belong to the largest group of tags that agree on where the others are on ``board``."""
    return _agreeing(tags, board.across, 1.0 + board.gap)


def other_layout(tags: Tags, board: AprilGrid) -> str:
    """Why ``tags`` cannot be those of ``board``, by their arrangement; empty where they may be."""
    own = agreeing_tags(tags, board)
    if len(tags) >= ENOUGH_TAGS and 2 * own.sum() <= len(tags):
        across, down, agreeing = _layout(tags)
        if agreeing > own.sum() and across == board.across:
            return f"the gap between the tags is not {board.gap:g} of a tag, as in {board.spec}: measure it"
        if agreeing > own.sum():
            return f"the tags are arranged {across} across and at least {down} down, not as on {board.spec}"
    return ""


def larger_grid(tags: Tags, board: AprilGrid) -> str:
    """Why ``tags`` belong to a grid with more rows than ``board``; empty where they may be its own."""
    down = int(tags.number[agreeing_tags(tags, board)].max()) // board.across + 1
    return f"a grid of at least {board.across}x{down} tags is larger than {board.spec}" if down > board.down else ""


def other_family(grey: Grey, board: AprilGrid) -> str:
    """The AprilGrid of another family than that of ``board`` that ``grey`` shows, in words; empty if there is none."""
    others = [family for family in FAMILIES if family != board.family]
    picture = stretched(grey)
    for border in BORDERS:
        seen = read_markers(picture, [FAMILIES[family] for family in others], border=border)
        for family, markers in zip(others, seen, strict=True):
            if len(markers) >= ENOUGH_TAGS:
                across, down, agreeing = _layout(_tags(markers, border, 1.0))
                if agreeing >= ENOUGH_TAGS:
                    return f"{family}, {across} across and at least {down} down"
    return ""


def _layout(tags: Tags) -> tuple[int, int, int]:
    """Tags across and down of the AprilGrid on which most of ``tags`` agree, and the number that agree."""
    offset, frame = _offsets(tags)
    sides = np.linalg.norm(np.linalg.solve(frame, offset.transpose(0, 2, 1)), axis=1)
    step = float(np.median(np.min(sides + np.diag(np.full(len(tags), np.inf)), axis=1)))
    groups = {across: _agreeing(tags, across, step) for across in range(2, MAX_TAGS_ACROSS + 1)}
    across = max(groups, key=lambda n: int(groups[n].sum()))
    down = int(tags.number[groups[across]].max()) // across + 1
    return across, down, int(groups[across].sum())


def _cells(tags: Tags, across: int) -> Ints:
    """Columns and rows (n, 2) of ``tags`` on a board of ``across`` tags; the lowest row is 0, those above negative."""
    row, column = np.divmod(tags.number, across)
    return np.stack([column, -row], axis=1)


def _offsets(tags: Tags) -> tuple[Floats, Floats]:
    """Vectors (n, n, 2) px between the tags' centres, and each tag's right and down sides (n, 2, 2) px as columns."""
    centre = tags.uv.mean(axis=(1, 2))
    right = (tags.uv[:, :, 1] - tags.uv[:, :, 0]).mean(axis=1)
    down = (tags.uv[:, 1] - tags.uv[:, 0]).mean(axis=1)
    return centre[None] - centre[:, None], np.stack([right, down], axis=2)


def _agreeing(tags: Tags, across: int, step: float) -> Bools:
    """Which tags (n,) form the largest agreeing group on a board of ``across`` tags, ``step`` tag sides apart."""
    if len(tags) < 2:
        return np.ones(len(tags), dtype=bool)
    cell = _cells(tags, across)
    away = cell[None] - cell[:, None]
    offset, frame = _offsets(tags)
    miss = np.linalg.norm(step * away @ frame.transpose(0, 2, 1) - offset, axis=2)
    agree = miss < AGREEMENT * np.linalg.norm(offset, axis=2)
    far = np.abs(away).max(axis=2)
    nearest = np.maximum(NEAR_TAGS, np.min(far + np.diag(np.full(len(tags), far.max() + 1)), axis=1))
    near = far <= np.maximum(nearest[:, None], nearest[None])
    _, group = connected_components(agree & agree.T & near, directed=False)
    return np.asarray(group == np.bincount(group).argmax())
