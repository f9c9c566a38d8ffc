"""AprilGrids: OpenCV reads some tags, their lattice predicts all corners, and the edge fit locates them.

On Kalibr's boards a black square touches each corner of a tag, so every corner is a crossing of two edges as on a
checkerboard, only unevenly spaced. A corner whose tag was not read (too small, bent, half hidden) is searched for
where the Gaussian process predicts it, and accepted if it is such a crossing. Plain tags without those squares have
no crossings and are rejected. (Olson, *AprilTag: A robust and flexible visual fiducial system*, 2011; Kalibr's
board: Maye, Furgale & Siegwart, 2013.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import FAMILIES, AprilGrid
from pinholify.corners import Corners, not_found, sorted_by_id
from pinholify.detection.growth import MIN_LATTICE_CORNERS, regular, signs
from pinholify.detection.intensity import Grey, grey_levels, reduced
from pinholify.detection.lattice import Lattice
from pinholify.detection.prediction import predict
from pinholify.detection.refine import refine_lattice
from pinholify.detection.saddle import refine_saddles
from pinholify.detection.tags import Tags, agreeing_tags, find_tags, larger_grid, other_family, other_layout

CLEAR_SHARE = 0.8
"""Half side of a window ÷ distance from the corner to the nearest thing outside its four sectors."""

MAX_WINDOW_PX = 12.0
"""Largest half window whose samples are dense enough to locate an edge; wider ones are fitted in a reduced image."""

INWARD_PX = 3.0
"""How far inside a tag's corner OpenCV may place it: the contour turns before the black square that touches it."""

SLIVER_AREA = 0.05
"""Area of a window ÷ product of its sides below which nothing can be seen between its edges."""

LEGIBLE_TAG_PX = 30.0
"""Side from which on tags are large enough for their corners to be found."""

MIN_FRAME_SHARE = 0.4
"""Smallest share of its size to which a window is reduced near the image's border."""

ROUGH_GAP, FINE_GAP = 0.1, 0.015
"""Tolerance of the gap between tags, in tag sides, before and after the lattice has grown."""

MIN_CORNERS_FOR_GAP = 20
"""Corners needed to distinguish a lens's distortion from a wrong gap: the cubic that is fitted has ten terms."""

DARK_FIRST = -1
"""The phase of all AprilGrids: the tag right and down of corner (0, 0) is dark."""


def detect_aprilgrid(image: NDArray[Any], board: AprilGrid, *, name: str, mirrored: bool = False) -> Corners:
    """The corners of ``board`` in ``image``; arguments and result as in :func:`pinholify.detection.detect_board`.

    ``mirrored`` is not used: tags are read in the flipped image too.
    """
    grey = grey_levels(image)
    for flipped in (False, True):
        picture = np.ascontiguousarray(grey[:, ::-1]) if flipped else grey
        tags = find_tags(picture, board)
        if len(tags):
            found = _of_tags(picture, tags, board, name)
            return replace(found, uv=found.uv * [-1, 1] + [grey.shape[1] - 1, 0]) if flipped else found
    other = other_family(grey, board)
    return not_found(name, f"no tag of the board {board.spec} was read" + f", but tags of {other}" * bool(other))


def _of_tags(grey: Grey, tags: Tags, board: AprilGrid, name: str) -> Corners:
    """The corners of ``board``, of which ``tags`` were read, or the reason why they are not accepted."""
    if reason := other_layout(tags, board):
        return not_found(name, reason)
    if reason := larger_grid(tags, board):
        return not_found(name, reason, larger_board=True)
    tags = tags.select(agreeing_tags(tags, board))
    grid = _grid(board, tags)
    levels = _levels(grey, tags, grid)
    seed = _snapped(levels, tags, grid)
    if abs((gap := _rough_gap(seed, board)) - board.gap) > ROUGH_GAP:
        return not_found(name, _other_gap(gap, board))
    grown = _grown(levels, seed, grid)
    if len(grown) < MIN_LATTICE_CORNERS:
        return not_found(name, _no_crossings(tags, board))
    fitted = refine_lattice(grey, grown, grid.fine)
    if len(fitted) < MIN_LATTICE_CORNERS:
        return not_found(name, f"only {len(fitted)} corners of the board {board.spec} were found")
    if len(fitted) >= MIN_CORNERS_FOR_GAP and abs((gap := _fine_gap(fitted, board)) - board.gap) > FINE_GAP:
        return not_found(name, _other_gap(gap, board))
    return sorted_by_id(Corners(name, fitted.ids(board), fitted.uv, fitted.weights))


def _other_gap(gap: float, board: AprilGrid) -> str:
    right = f"aprilgrid:{board.across}x{board.down}:{board.family}:{gap:.2f}"
    return f"the gap between the tags is {gap:.2f} of a tag, not {board.gap:g}: give {right} if that is the board"


def _no_crossings(tags: Tags, board: AprilGrid) -> str:
    read = "1 tag was read" if len(tags) == 1 else f"{len(tags)} tags were read"
    side = float(np.median(np.linalg.norm(np.diff(tags.uv, axis=2), axis=3)))
    small = f". The tags' sides are only {side:.0f} px long: move closer" if side < LEGIBLE_TAG_PX else ""
    return (
        f"{read}, but too few corners of the board {board.spec} were found: the tags must have this gap between them "
        f"and black squares between their corners, as Kalibr and 'pinholify board' print them{small}"
    )


# --- from tags to all corners -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Places:
    """Positions of lattice indices on ``board``, in units of ``step`` tag sides."""

    board: AprilGrid
    step: float

    def __call__(self, index: Ints) -> Floats:
        return self.board.places(index[:, 0], index[:, 1]) / self.step


@dataclass(frozen=True, slots=True)
class _Grid:
    """A ``board`` and the half ``window`` (tag sides) around a corner that holds only its four sectors."""

    board: AprilGrid
    window: float

    @property
    def even(self) -> _Places:
        """Positions in units of the mean distance of corners, used to predict the lattice."""
        return _Places(self.board, (1.0 + self.board.gap) / 2.0)

    @property
    def fine(self) -> _Places:
        """Positions in units of three half windows, used by the final fit."""
        return _Places(self.board, 3.0 * self.window)

    def frames(self, jacobian: Floats) -> Floats:
        """Half windows (n, 2, 2) px where a step of :attr:`even` is ``jacobian`` (n, 2, 2) px."""
        return jacobian * (self.window / self.even.step)


def _grid(board: AprilGrid, tags: Tags) -> _Grid:
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[board.family]))
    return _Grid(board, CLEAR_SHARE * min(board.gap, tags.border / (family.markerSize + 2 * tags.border)))


def _levels(grey: Grey, tags: Tags, grid: _Grid) -> list[Grey]:
    """``grey`` and its reductions by powers of two, as far as the windows of the largest of ``tags`` require."""
    widest = np.ptp(tags.uv, axis=(1, 2)).max() * grid.window
    return [reduced(grey, level) for level in range(1 + int(_level(widest)))]


def _level(width: Floats) -> Ints:
    """How often the image has to be halved for half windows of ``width`` px."""
    return np.ceil(np.log2(np.maximum(width / MAX_WINDOW_PX, 1.0))).astype(np.int64)


def _snapped(levels: list[Grey], tags: Tags, grid: _Grid) -> Lattice:
    """The corners of ``tags`` that have a crossing of the right colours at, or just outside, their rough positions."""
    index, uv = tags.corners(grid.board)
    place = grid.even(index)
    frames = grid.frames(predict(place, uv, place).jacobian)
    outward = uv - tags.uv.mean(axis=(1, 2)).repeat(4, axis=0)
    outward *= INWARD_PX / np.linalg.norm(outward, axis=1, keepdims=True)
    found = Lattice(index[:0], uv[:0], np.empty(0), DARK_FIRST)
    for start in (uv, uv + outward):
        new = ~(index[:, None] == found.index[None]).all(axis=2).any(axis=1)
        rough = Lattice(index, start, np.ones(len(index)), DARK_FIRST).select(new)
        snapped = _crossings(levels, rough, frames[new])
        found = found.joined(snapped.index, snapped.uv)
    return found


def _crossings(levels: list[Grey], expected: Lattice, frames: Floats) -> Lattice:
    """``expected`` moved to the saddles in its ``frames`` (n, 2, 2) px; corners without one are dropped.

    Frames that reach beyond the image are reduced, to MIN_FRAME_SHARE of their size at most; slivers are skipped.
    """
    wide = np.abs(np.linalg.det(frames)) > SLIVER_AREA * np.prod(np.linalg.norm(frames, axis=1), axis=1)
    size = np.array([levels[0].shape[1], levels[0].shape[0]]) - 1
    room = np.minimum(expected.uv, size - expected.uv)
    shrunk = np.minimum((room / np.abs(frames).sum(axis=2)).min(axis=1), 1.0)
    inside = wide & (shrunk > MIN_FRAME_SHARE)
    expected, frames = expected.select(inside), (frames * shrunk[:, None, None])[inside]
    level = np.minimum(_level(np.linalg.norm(frames, axis=1).max(axis=1)), len(levels) - 1)
    uv, clear = expected.uv.copy(), np.zeros(len(expected), dtype=bool)
    for k in np.unique(level):
        at = level == k
        uv[at], clear[at] = _saddles(levels[k], k, expected.select(at), frames[at])
    return expected.moved(uv).select(clear)


def _saddles(grey: Grey, level: int, expected: Lattice, frames: Floats) -> tuple[Floats, Bools]:
    """Saddles (n, 2) px near ``expected``, and which (n,) are clear, in ``grey``, the image halved ``level`` times."""
    factor = 2**level
    saddles = refine_saddles(grey, (expected.uv + 0.5) / factor - 0.5, frames / factor)
    strength = saddles.strength * signs(expected.index, expected.phase)
    clear = saddles.sound & (strength > 0) & (saddles.residual < 0.35 * strength)
    return (saddles.uv + 0.5) * factor - 0.5, clear


def _grown(levels: list[Grey], lattice: Lattice, grid: _Grid) -> Lattice:
    """``lattice`` grown ring by ring over the board, without irregular corners."""
    lattice = lattice.select(regular(lattice, grid.even(lattice.index)))
    while len(lattice) >= 4:
        larger = _ring(levels, lattice, grid)
        if len(larger) <= len(lattice):
            break
        lattice = larger
    return lattice


def _ring(levels: list[Grey], lattice: Lattice, grid: _Grid) -> Lattice:
    """``lattice`` with the corners found one step, or failing that two steps, beyond it."""
    column, row = np.meshgrid(np.arange(grid.board.columns), np.arange(grid.board.rows))
    everything = np.stack([column.ravel(), row.ravel()], axis=1)
    steps = np.abs(everything[:, None] - lattice.index[None]).max(axis=2).min(axis=1)
    for reach in (1, 2):
        ring = everything[(steps > 0) & (steps <= reach)]
        if not len(ring):
            continue
        expected = predict(grid.even(lattice.index), lattice.uv, grid.even(ring))
        usual = np.median(np.linalg.norm(expected.jacobian, axis=1))
        certain = 3 * expected.std < np.minimum(expected.spacing, usual)
        rough = Lattice(ring, expected.uv, np.ones(len(ring)), DARK_FIRST).select(certain)
        found = _crossings(levels, rough, grid.frames(expected.jacobian[certain]))
        grown = lattice.joined(found.index, found.uv)
        grown = grown.select(regular(grown, grid.even(grown.index)))
        if len(grown) > len(lattice):
            return grown
    return lattice


# --- the gap between tags ---------------------------------------------------------------------------


def _rough_gap(corners: Lattice, board: AprilGrid) -> float:
    """The gap between neighbouring tags, from their ``corners``; that of ``board`` where there are no neighbours.

    Homographies preserve the cross ratio of four corners in a line, (1 + gap)² / ((1 + gap)² - 1).
    """
    grid = np.full((board.rows, board.columns, 2), np.nan)
    grid[corners.index[:, 1], corners.index[:, 0]] = corners.uv
    ratios = np.concatenate([_cross_ratios(grid).ravel(), _cross_ratios(grid.transpose(1, 0, 2)).ravel()])
    ratios = ratios[ratios > 1.0]
    if not len(ratios):
        return board.gap
    ratio = float(np.median(ratios))
    return float(np.sqrt(ratio / (ratio - 1.0)) - 1.0)


def _cross_ratios(grid: Floats) -> Floats:
    """Cross ratios (rows, pairs) of the corners of neighbouring tags along the rows of ``grid`` (rows, columns, 2)."""
    a, b, c, d = grid[:, :-2:2], grid[:, 1:-2:2], grid[:, 2::2], grid[:, 3::2]
    ac, bd, bc, ad = (np.linalg.norm(end - start, axis=2) for start, end in ((a, c), (b, d), (b, c), (a, d)))
    return np.asarray(ac * bd / (bc * ad))


def _fine_gap(corners: Lattice, board: AprilGrid) -> float:
    """The gap with which a cubic from the board to the image fits ``corners`` best: lens distortion is smooth."""
    powers = [(i, j) for i in range(4) for j in range(4 - i)]

    def misfit(gap: float) -> float:
        place = replace(board, gap=gap).places(corners.index[:, 0], corners.index[:, 1])
        x, y = ((place - place.mean(axis=0)) / np.ptp(place)).T
        terms = np.stack([x**i * y**j for i, j in powers], axis=1)
        coefficients = np.linalg.lstsq(terms, corners.uv, rcond=None)[0]
        return float(((corners.uv - terms @ coefficients) ** 2).sum())

    nearby = max(board.gap - ROUGH_GAP, 0.01), min(board.gap + ROUGH_GAP, 1.0)
    return float(minimize_scalar(misfit, bounds=nearby, method="bounded").x)
