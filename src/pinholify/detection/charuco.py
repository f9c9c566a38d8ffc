"""ChArUco boards: OpenCV's marker detector gives the ids, the lattice search and the edge fits give the corners.

The homography of a marker gives the rough positions of its square's corners. Candidates there seed a lattice of known
indices, which is then grown and fitted like that of any checkerboard: corners whose markers are hidden or blurred are
found too, and lens distortion does no harm as long as markers are read. (Garrido-Jurado et al., *Automatic
generation and detection of highly reliable fiducial markers under occlusion*, 2014, for the markers.)
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Floats, Ints
from pinholify.board import Charuco
from pinholify.corners import Corners, not_found, sorted_by_id
from pinholify.detection.candidates import find_candidates
from pinholify.detection.growth import BESIDE_EDGE, FEWEST_CORNERS, Grower, grower, regular
from pinholify.detection.intensity import Grey, grey_levels, stretched
from pinholify.detection.lattice import Lattice
from pinholify.detection.markers import read_markers
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

BLACK_FIRST = -1
"""The phase of a board whose first square is black."""


def detect_charuco(image: NDArray[Any], board: Charuco, *, name: str, mirrored: bool = False) -> Corners:
    """The corners of ``board`` in ``image``; arguments and result as in :func:`pinholify.detection.detect_board`.

    ``mirrored`` is not used: markers are read in the flipped image too.
    """
    grey = grey_levels(image)
    read = _around_markers(grey, board)
    flipped = read is None
    if flipped:
        grey = np.ascontiguousarray(grey[:, ::-1])
        read = _around_markers(grey, board)
    if read is None:
        other = _other_dictionary(grey, board)
        return not_found(
            name, f"too few markers of the board {board.spec} were found" + f", but those of {other}" * bool(other)
        )
    growing = grower(grey, find_candidates(grey), beside=min(BESIDE_EDGE, (1.0 - board.marker) / 4.0))
    seed = _seed(growing, read)
    if len(seed) < FEWEST_CORNERS:
        return not_found(name, f"markers of the board {board.spec} were read, but only {len(seed)} corners beside them")
    fitted = refine_lattice(grey, _on_board(growing.grow(seed), board))
    if len(fitted) < FEWEST_CORNERS:
        return not_found(name, f"only {len(fitted)} corners of the board {board.spec} were found")
    uv = fitted.uv * [-1, 1] + [grey.shape[1] - 1, 0] if flipped else fitted.uv
    return sorted_by_id(Corners(name, fitted.ids(board), uv, fitted.weights))


def _other_dictionary(grey: Grey, board: Charuco) -> str:
    """The dictionary, other than that of ``board``, of the markers in the flipped ``grey``; empty if none are read."""
    picture = stretched(np.ascontiguousarray(grey[:, ::-1]))
    own = board.dictionary.rsplit("_", 1)[0]
    most = max(read_markers(picture, [name for name in USUAL_DICTIONARIES if not name.startswith(own)]), key=len)
    return f"{most.dictionary} or a larger one" if len(most) >= FEWEST_CORNERS else ""


def _around_markers(grey: Grey, board: Charuco) -> Lattice | None:
    """Rough corners of the squares whose markers are read; None where they are fewer than a lattice needs.

    A corner on which its two markers disagree is left out.
    """
    index, uv = _squares(grey, board)
    inside = ((index >= 0) & (index < [board.columns, board.rows])).all(axis=2)
    side = np.broadcast_to(np.linalg.norm(uv - np.roll(uv, 1, axis=1), axis=2).min(axis=1, keepdims=True), inside.shape)
    corner, position, count = np.unique(index[inside], axis=0, return_inverse=True, return_counts=True)
    position = position.ravel()
    mean = np.zeros((len(corner), 2))
    np.add.at(mean, position, uv[inside] / count[position, None])
    agreed = np.ones(len(corner), dtype=bool)
    agreed[position[np.linalg.norm(uv[inside] - mean[position], axis=1) > AGREEMENT * side[inside]]] = False
    if agreed.sum() < FEWEST_CORNERS or min(np.ptp(corner[agreed], axis=0)) == 0:  # one line has no second direction
        return None
    return Lattice(corner[agreed], mean[agreed], np.ones(int(agreed.sum())), BLACK_FIRST)


def _squares(grey: Grey, board: Charuco) -> tuple[Ints, Floats]:
    """Indices (n, 4, 2) of the corners of squares whose markers are read, and their rough pixels (n, 4, 2)."""
    markers = read_markers(stretched(grey), [board.dictionary])[0]
    column, row = np.meshgrid(np.arange(board.columns + 1), np.arange(board.rows + 1))
    white = np.stack([column, row], axis=-1)[(column + row) % 2 == 1]
    index, uv = [np.empty((0, 4, 2), dtype=np.int64)], [np.empty((0, 4, 2))]
    for quad, number in zip(markers.quads.astype(np.float32), markers.number.tolist(), strict=True):
        if number < len(white):
            homography = cv2.getPerspectiveTransform((board.marker * SQUARE).astype(np.float32), quad)
            index.append(white[number] - [1, 1] + (SQUARE + 0.5).astype(np.int64)[None])
            uv.append(apply_homography(np.asarray(homography, dtype=np.float64), SQUARE)[None])
    return np.concatenate(index), np.concatenate(uv)


def _seed(growing: Grower, rough: Lattice) -> Lattice:
    """The candidates near ``rough`` corners that the other corners predict too."""
    expected = predict(rough.index, rough.uv, rough.index, leave_out=True)
    uv, found = growing.match(rough.index, expected, rough)
    seed = rough.moved(uv).select(found)
    return seed.select(regular(seed))


def _on_board(lattice: Lattice, board: Charuco) -> Lattice:
    inside = (lattice.index >= 0) & (lattice.index < [board.columns, board.rows])
    return lattice.select(np.asarray(inside.all(axis=1)))
