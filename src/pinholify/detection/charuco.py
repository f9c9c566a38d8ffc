"""ChArUco boards: OpenCV's marker detector gives the ids, the lattice search and the edge fits give the corners.

The homography of a marker gives the rough positions of its square's corners. Candidates there seed a lattice of known
indices, which is then grown and fitted like that of any checkerboard: corners whose markers are hidden or blurred are
found too, and lens distortion does no harm as long as markers are read. (Garrido-Jurado et al., *Automatic
generation and detection of highly reliable fiducial markers under occlusion*, 2014, for the markers.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Floats
from pinholify.board import Charuco
from pinholify.corners import Corners, not_found, sorted_by_id
from pinholify.detection.candidates import find_candidates
from pinholify.detection.growth import BESIDE_EDGE, MIN_LATTICE_CORNERS, Grower, grower, regular
from pinholify.detection.intensity import Grey, grey_levels, stretched
from pinholify.detection.lattice import Lattice
from pinholify.detection.markers import Markers, read_markers
from pinholify.detection.prediction import predict
from pinholify.detection.refine import refine_lattice
from pinholify.geometry import apply_homography

SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
"""Corners of a square about its middle, in the order of a marker's."""

AGREEMENT = 0.25
"""How far from their mean, as a fraction of a square, two markers may place the corner between them."""

USUAL_DICTIONARIES = (
    "DICT_4X4_50",
    "DICT_5X5_50",
    "DICT_6X6_50",
    "DICT_7X7_50",
    "DICT_ARUCO_ORIGINAL",
    "DICT_APRILTAG_36h11",
)
"""Dictionaries that are tried where the requested one is not seen; larger ones begin with the same markers."""

PHASES = BLACK_FIRST, WHITE_FIRST = -1, 1
"""The phase of a board whose first square is black, and of one whose first square is white and holds marker 0.

OpenCV before 4.6, and calib.io still, begin boards of an even number of rows with a white square
(https://github.com/opencv/opencv/issues/23152)."""

MOST_SQUARES, MARKER_SIDES = 40, np.linspace(0.3, 0.9, 13).tolist()
"""Squares of a row, and sides of a marker in squares, to try where markers stand otherwise than on the board."""


def detect_charuco(image: NDArray[Any], board: Charuco, *, name: str, mirrored: bool = False) -> Corners:
    """The corners of ``board`` in ``image``; arguments and result as in :func:`pinholify.detection.detect_board`.

    ``mirrored`` is not used: markers are read in the flipped image too.
    """
    plain = _read(grey_levels(image), board)
    sure = _agreed(plain.rough) >= MIN_LATTICE_CORNERS
    flipped = plain if sure else _read(np.ascontiguousarray(plain.grey[:, ::-1]), board)
    read = max(plain, flipped, key=lambda each: len(each.markers))
    # A line has no second direction.
    if len(read.rough) < MIN_LATTICE_CORNERS or min(np.ptp(read.rough.index, axis=0)) == 0:
        return not_found(name, _instead(read, board) or f"too few markers of the board {board.spec} were found")
    growing = grower(read.grey, find_candidates(read.grey), beside=min(BESIDE_EDGE, (1.0 - board.marker) / 4.0))
    seed = _seed(growing, read.rough)
    if len(seed) < MIN_LATTICE_CORNERS:
        few = f"markers of the board {board.spec} were read, but only {len(seed)} corners beside them"
        return not_found(name, _instead(read, board) or few)
    fitted = refine_lattice(read.grey, _on_board(growing.grow(seed), board))
    if len(fitted) < MIN_LATTICE_CORNERS:
        return not_found(name, f"only {len(fitted)} corners of the board {board.spec} were found")
    uv = fitted.uv if read is plain else fitted.uv * [-1, 1] + [read.grey.shape[1] - 1, 0]
    return sorted_by_id(Corners(name, fitted.ids(board), uv, fitted.weights))


@dataclass(frozen=True, slots=True, eq=False)
class _Read:
    """Markers read in ``grey``, and the ``rough`` corners of their squares."""

    grey: Grey
    markers: Markers
    rough: Lattice


def _read(grey: Grey, board: Charuco) -> _Read:
    """The markers of ``board`` in ``grey``; its first square may be white if it has an even number of rows."""
    markers = read_markers(stretched(grey), [board.dictionary])[0]
    columns, rows = board.columns + 1, board.rows + 1
    phases = PHASES if rows % 2 == 0 else (BLACK_FIRST,)
    arranged = [_arranged(markers, columns, rows, phase, board.marker) for phase in phases]
    return _Read(grey, markers, max(arranged, key=_agreed))


def _instead(read: _Read, board: Charuco) -> str:
    """What ``read`` shows instead of the ``board``, in words; empty where nothing is recognised."""
    declared = board.columns + 1
    columns, by_columns = _most_agreed(
        read.markers, {float(n): (n, board.marker) for n in range(3, MOST_SQUARES + 1)}
    )
    side, by_side = _most_agreed(read.markers, {side: (declared, side) for side in MARKER_SIDES})
    if by_side > max(by_columns, MIN_LATTICE_CORNERS):
        return f"markers were read, but their side is about {side:.1g} of a square's, not {board.marker:g}"
    if by_columns >= MIN_LATTICE_CORNERS and columns != declared:
        return f"markers were read, but they stand as on a board of {columns:g} columns of squares, not {declared}"
    dictionary = _other_dictionary(read.grey, board)
    return f"no markers of {board.dictionary} were found, but those of {dictionary} or a larger one" * bool(dictionary)


def _most_agreed(markers: Markers, guesses: dict[float, tuple[int, float]]) -> tuple[float, int]:
    """The mean of the ``guesses`` at which the ``markers`` agree on most corners, and the number of those corners.

    Each guess has a number of columns of squares, and the side of a marker in squares.
    """
    agreed = {
        guess: max(_agreed(_arranged(markers, columns, MOST_SQUARES, phase, side)) for phase in PHASES)
        for guess, (columns, side) in guesses.items()
    }
    most = max(agreed.values())
    return float(np.mean([guess for guess in agreed if agreed[guess] == most])), most


def _other_dictionary(grey: Grey, board: Charuco) -> str:
    """The dictionary, other than that of ``board``, of the markers in ``grey``; empty if none are read."""
    own = board.dictionary.rsplit("_", 1)[0]
    others = [name for name in USUAL_DICTIONARIES if not name.startswith(own)]
    most = max(read_markers(stretched(grey), others), key=len)
    return most.dictionary if len(most) >= MIN_LATTICE_CORNERS else ""


def _arranged(markers: Markers, columns: int, rows: int, phase: int, side: float) -> Lattice:
    """Rough corners around the ``markers``, of ``side`` squares, in the white ones of ``columns`` × ``rows`` squares.

    Their weights are the numbers of markers that place them. A corner on which two disagree is left out.
    """
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    white = np.stack([column, row], axis=-1)[(column + row) % 2 == (phase == BLACK_FIRST)]
    shown = markers.select(markers.number < len(white))
    index, uv = white[shown.number][:, None] - [1, 1] + (SQUARE + 0.5).astype(np.int64), _squares(shown, side)
    inside = ((index >= 0) & (index < [columns - 1, rows - 1])).all(axis=2)
    length = np.linalg.norm(uv - np.roll(uv, 1, axis=1), axis=2).min(axis=1, keepdims=True)
    tolerance = AGREEMENT * np.broadcast_to(length, inside.shape)[inside]
    corner, position, count = np.unique(index[inside], axis=0, return_inverse=True, return_counts=True)
    position = position.ravel()
    mean = np.zeros((len(corner), 2))
    np.add.at(mean, position, uv[inside] / count[position, None])
    good = np.ones(len(corner), dtype=bool)
    good[position[np.linalg.norm(uv[inside] - mean[position], axis=1) > tolerance]] = False
    return Lattice(corner[good], mean[good], count[good].astype(np.float64), phase)


def _agreed(rough: Lattice) -> int:
    """The number of corners that two markers place alike."""
    return int((rough.weights > 1).sum())


def _squares(markers: Markers, side: float) -> Floats:
    """Rough corners (n, 4, 2) px of the squares around ``markers``, whose side is ``side`` of a square's."""
    uv = [np.empty((0, 4, 2))]
    for quad in markers.quads.astype(np.float32):
        homography = cv2.getPerspectiveTransform((side * SQUARE).astype(np.float32), quad)
        uv.append(apply_homography(np.asarray(homography, dtype=np.float64), SQUARE)[None])
    return np.concatenate(uv)


def _seed(growing: Grower, rough: Lattice) -> Lattice:
    """The candidates near ``rough`` corners that the other corners predict too."""
    expected = predict(rough.index, rough.uv, rough.index, leave_out=True)
    uv, found = growing.match(rough.index, expected, rough)
    seed = rough.moved(uv, np.ones(len(uv))).select(found)
    return seed.select(regular(seed))


def _on_board(lattice: Lattice, board: Charuco) -> Lattice:
    inside = (lattice.index >= 0) & (lattice.index < [board.columns, board.rows])
    return lattice.select(np.asarray(inside.all(axis=1)))
