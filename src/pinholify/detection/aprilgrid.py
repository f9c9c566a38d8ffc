"""AprilGrids: OpenCV's marker detector reads some tags, the lattice they span predicts all other corners, and our
own fit places them.

On Kalibr's boards a black square touches each corner of a tag, so every corner is a crossing of two edges like a
checkerboard's, only unevenly spaced. A corner whose tag was not read (too small, bent, half hidden) is looked for
where the Gaussian process expects it, and counts if it is such a crossing. Plain tags without those squares have
no crossings and are not believed. (Olson, *AprilTag: A robust and flexible visual fiducial system*, 2011; Kalibr's
board: Maye, Furgale & Siegwart, 2013.)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import FAMILIES, AprilGrid
from pinholify.corners import Corners, not_found
from pinholify.detection.growth import FEWEST, regular, signs
from pinholify.detection.intensity import Grey, grey_levels, stretched
from pinholify.detection.lattice import Lattice
from pinholify.detection.prediction import predict
from pinholify.detection.refine import refine_lattice
from pinholify.detection.saddle import refine_saddles

BORDERS = (2, 1)
"""Black cells around a tag's code: Kalibr's, then AprilTag's own."""

ENOUGH = 4
"""Tags after which no other rendering of the image is tried; the lattice finds the other tags' corners."""

SMOOTHING = 1.2
"""Standard deviation (px) of the blur that makes a noisy image's tags legible."""

LARGE = 4_000_000
"""Pixels from which on an image is read at half size too, and below which at twice its size."""

CLEAR = 0.8
"""Of the distance from a corner to the nearest thing that is none of its four sectors, a window's half side."""

LEAST_FRAME = 0.4
"""Of a window's size where the image ends beside its corner."""

AGREEING = 0.25
"""Two tags agree where each predicts the other's centre to this share of their distance."""

DARK_FIRST = -1
"""The phase of all AprilGrids: the tag right and down of corner (0, 0) is dark."""


@dataclass(frozen=True, slots=True, eq=False)
class Tags:
    """Tags read in an image: ``column`` and ``row`` (n,) from the top left, ``uv`` (n, 2, 2, 2) px of their corners.

    ``uv[k, j, i]`` is the corner i to the right and j down. ``border`` is how many black cells surround the code.
    """

    column: Ints
    row: Ints
    uv: Floats
    border: int

    def __len__(self) -> int:
        """Number of tags."""
        return len(self.column)

    def select(self, keep: Bools) -> Tags:
        """The tags where ``keep`` (n,) is true."""
        return Tags(self.column[keep], self.row[keep], self.uv[keep], self.border)

    def corners(self) -> tuple[Ints, Floats]:
        """Lattice indices (4n, 2) of all corners and their places (4n, 2) px."""
        end = np.array([[[0, 0], [1, 0]], [[0, 1], [1, 1]]])
        index = 2 * np.stack([self.column, self.row], axis=1)[:, None, None] + end
        return index.reshape(-1, 2), self.uv.reshape(-1, 2)


def detect_aprilgrid(image: NDArray[Any], board: AprilGrid, *, name: str) -> Corners:
    """The tags' corners of ``board`` in ``image``, by their ids; the tags tell a reflection by themselves.

    ``image`` and the result are as of :func:`pinholify.detection.detect_board`.
    """
    grey = grey_levels(image)
    tags = find_tags(grey, board)
    flipped = not len(tags)
    if flipped:
        grey = np.ascontiguousarray(grey[:, ::-1])
        tags = find_tags(grey, board)
    if not len(tags):
        return not_found(name, f"no tag of a {board.spec} board was read")
    places = _Places(board, _clear_distance(board, tags))
    seed = _snapped(grey, *tags.corners(), places)
    grown = _grown(grey, seed, board, places)
    if len(grown) < FEWEST:
        return not_found(name, _no_crossings(len(tags), board))
    fitted = refine_lattice(grey, grown, places)
    if len(fitted) < FEWEST:
        return not_found(name, f"only {len(fitted)} corners of a {board.spec} board were found")
    uv = fitted.uv * [-1, 1] + [grey.shape[1] - 1, 0] if flipped else fitted.uv
    ids = fitted.ids(board)
    order = np.argsort(ids)
    return Corners(name, ids[order], uv[order], fitted.weights[order])


def _no_crossings(tags: int, board: AprilGrid) -> str:
    read = "1 tag was read" if tags == 1 else f"{tags} tags were read"
    return (
        f"{read}, but too few corners of a {board.spec} board were found: "
        "its tags need the black squares between their corners, as Kalibr and 'pinholify board' print them"
    )


# --- reading tags -----------------------------------------------------------------------------------


def find_tags(grey: Grey, board: AprilGrid) -> Tags:
    """The tags of ``board`` in ``grey`` that agree with one another; none where there are none."""
    best = _no_tags()
    for factor, picture in _pictures(grey):
        for border in BORDERS:
            tags = _read(picture, board, border, factor)
            best = max(best, tags.select(_agreeing(tags, board)), key=len)
            if len(best) >= ENOUGH:
                return best
    return best


def _no_tags() -> Tags:
    nothing = np.empty(0, dtype=np.int64)
    return Tags(nothing, nothing, np.empty((0, 2, 2, 2)), BORDERS[0])


def _pictures(grey: Grey) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """What to read tags in, and how many times as large as the image: as it is, for noise smoothed, at another size."""
    yield 1.0, stretched(grey)
    yield 1.0, stretched(cv2.GaussianBlur(grey, (0, 0), SMOOTHING).astype(np.float32))
    factor = 2.0 if grey.size < LARGE else 0.5
    how = cv2.INTER_CUBIC if factor > 1 else cv2.INTER_AREA
    yield factor, stretched(cv2.resize(grey, None, fx=factor, fy=factor, interpolation=how).astype(np.float32))


def _read(picture: NDArray[np.uint8], board: AprilGrid, border: int, factor: float) -> Tags:
    """The tags with a black border of ``border`` cells, the largest of each number, in px of the image.

    The image is ``factor`` times smaller than the ``picture`` of it.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border
    parameters.perspectiveRemovePixelPerCell = 8  # bent edges leave fewer good pixels in a cell
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[board.family]))
    quads, numbers, _ = cv2.aruco.ArucoDetector(family, parameters).detectMarkers(picture)
    size = board.across * board.down
    seen: dict[int, Floats] = {}
    for quad, number in zip(quads, [] if numbers is None else np.ravel(numbers).tolist(), strict=True):
        uv = (np.asarray(quad, dtype=np.float64).reshape(4, 2) + 0.5) / factor - 0.5
        if number < size and (number not in seen or _area(uv) > _area(seen[number])):
            seen[number] = uv
    number = np.array(list(seen), dtype=np.int64)
    uv = np.array(list(seen.values())).reshape(-1, 4, 2)
    # OpenCV goes clockwise from what is its top left and Kalibr's bottom right.
    turned = uv[:, [2, 3, 1, 0]].reshape(-1, 2, 2, 2)
    row, column = np.divmod(number, board.across)
    return Tags(column, board.down - 1 - row, turned, border)


def _area(uv: Floats) -> float:
    return float(abs(cv2.contourArea(uv.astype(np.float32))))


def _agreeing(tags: Tags, board: AprilGrid) -> Bools:
    """Which tags (n,) belong to the largest group of tags that agree on where the others are."""
    if len(tags) < 2:
        return np.ones(len(tags), dtype=bool)
    step = 1.0 + board.gap
    centre = tags.uv.mean(axis=(1, 2))
    across = (tags.uv[:, :, 1] - tags.uv[:, :, 0]).mean(axis=1) * step
    down = (tags.uv[:, 1] - tags.uv[:, 0]).mean(axis=1) * step
    columns = tags.column[None] - tags.column[:, None]
    rows = tags.row[None] - tags.row[:, None]
    expected = centre[:, None] + columns[:, :, None] * across[:, None] + rows[:, :, None] * down[:, None]
    miss = np.linalg.norm(expected - centre[None], axis=2)
    distance = np.linalg.norm(centre[:, None] - centre[None], axis=2)
    agree = miss < AGREEING * distance
    _, group = connected_components(agree & agree.T, directed=False)
    return np.asarray(group == np.bincount(group).argmax())


# --- from tags to all corners -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Places:
    """Where the corners of an index lie on ``board``, in steps in which a third is a good half window.

    ``clear`` is how far (tags) a corner's four sectors reach at least.
    """

    board: AprilGrid
    clear: float

    def __call__(self, index: Ints) -> Floats:
        return self.board.places(index[:, 0], index[:, 1]) / (3.0 * CLEAR * self.clear)


def _clear_distance(board: AprilGrid, tags: Tags) -> float:
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[board.family]))
    return min(board.gap, tags.border / (family.markerSize + 2 * tags.border))


def _snapped(grey: Grey, index: Ints, uv: Floats, places: _Places) -> Lattice:
    """The corners among ``index`` (n, 2) at whose rough ``uv`` (n, 2) a crossing of the right colours is."""
    known = Lattice(index, uv, np.ones(len(index)), DARK_FIRST)
    frames = predict(places(index), uv, places(index)).jacobian / 3.0
    return _crossings(grey, known, frames)


def _crossings(grey: Grey, expected: Lattice, frames: Floats) -> Lattice:
    """``expected`` moved to the saddles in its ``frames`` (n, 2, 2) px, those that have one.

    Frames that reach beyond the image are made smaller, down to LEAST_FRAME of their size.
    """
    size = np.array([grey.shape[1], grey.shape[0]]) - 1
    room = np.minimum(expected.uv, size - expected.uv)
    shrunk = np.minimum((room / np.abs(frames).sum(axis=2)).min(axis=1), 1.0)
    inside = shrunk > LEAST_FRAME
    expected, frames = expected.select(inside), (frames * shrunk[:, None, None])[inside]
    if not len(expected):
        return expected
    saddles = refine_saddles(grey, expected.uv, frames)
    strength = saddles.strength * signs(expected.index, expected.phase)
    clear = saddles.sound & (strength > 0) & (saddles.residual < 0.35 * strength)
    return Lattice(expected.index, saddles.uv, expected.weights, expected.phase).select(clear)


def _grown(grey: Grey, lattice: Lattice, board: AprilGrid, places: _Places) -> Lattice:
    """``lattice`` with every corner of ``board`` that can be reached from it in rings, without those that break it."""
    column, row = np.meshgrid(np.arange(board.columns), np.arange(board.rows))
    everything = np.stack([column.ravel(), row.ravel()], axis=1)
    lattice = lattice.select(regular(lattice, places(lattice.index)))
    while len(lattice) >= 4:
        steps = np.abs(everything[:, None] - lattice.index[None]).max(axis=2).min(axis=1)
        ring = everything[(steps > 0) & (steps <= 2)]
        if not len(ring):
            break
        expected = predict(places(lattice.index), lattice.uv, places(ring))
        usual = np.median(np.linalg.norm(expected.jacobian, axis=1))
        believed = 3 * expected.std < np.minimum(expected.spacing, usual)
        found = _crossings(
            grey,
            Lattice(ring, expected.uv, np.ones(len(ring)), DARK_FIRST).select(believed),
            expected.jacobian[believed] / 3.0,
        )
        grown = lattice.joined(found.index, found.uv)
        grown = grown.select(regular(grown, places(grown.index)))
        if len(grown) <= len(lattice):
            break
        lattice = grown
    return lattice
