"""ChArUco boards: OpenCV's marker detector tells the ids, the lattice search and the saddle fits give the
corners.

The corners that OpenCV interpolates between markers seed a lattice of known indices, which then grows and is
fitted as that of any checkerboard: corners whose markers are hidden or blurred are found too. (Garrido-Jurado
et al., *Automatic generation and detection of highly reliable fiducial markers under occlusion*, 2014, for
the markers.)
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.board import Charuco
from pinholify.corners import Corners, not_found
from pinholify.detection.candidates import find_candidates
from pinholify.detection.growth import FEWEST, grower, signs
from pinholify.detection.intensity import Grey, grey_levels, stretched
from pinholify.detection.lattice import Lattice
from pinholify.detection.prediction import local_frames
from pinholify.detection.refine import refine_lattice
from pinholify.detection.saddle import saddle_strength


def detect_charuco(image: NDArray[Any], board: Charuco, *, name: str) -> Corners:
    """The chessboard corners of ``board`` in ``image``, by their ids; the markers tell a reflection by
    themselves.

    ``image`` and the result are as of :func:`pinholify.detection.detect_board`.
    """
    grey = grey_levels(image)
    seed = _seed(grey, board)
    flipped = seed is None
    if flipped:
        grey = np.ascontiguousarray(grey[:, ::-1])
        seed = _seed(grey, board)
    if seed is None:
        return not_found(name, f"too few markers of a {board.spec} board were found")
    grown = grower(grey, find_candidates(grey)).grow(seed)
    fitted = refine_lattice(grey, _on_board(grown, board))
    if len(fitted) < FEWEST:
        return not_found(name, f"only {len(fitted)} corners of a {board.spec} board were found")
    uv = fitted.uv * [-1, 1] + [grey.shape[1] - 1, 0] if flipped else fitted.uv
    ids = fitted.ids(board)
    order = np.argsort(ids)
    return Corners(name, ids[order], uv[order], fitted.weights[order])


def _seed(grey: Grey, board: Charuco) -> Lattice | None:
    """The corners that OpenCV interpolates from the markers, or None where they are fewer than a lattice
    needs.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    pattern = cv2.aruco.CharucoBoard((board.columns + 1, board.rows + 1), 1.0, board.marker, dictionary)
    uv, ids, _, _ = cv2.aruco.CharucoDetector(pattern).detectBoard(stretched(grey))
    if ids is None or len(ids) < FEWEST:
        return None
    row, column = np.divmod(np.asarray(ids, dtype=np.int64).ravel(), board.columns)
    index = np.stack([column, row], axis=1)
    place = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
    if min(np.ptp(index, axis=0)) == 0:  # A single line of corners has no second direction.
        return None
    jacobian, _ = local_frames(index, place)
    strength = saddle_strength(grey, place, 0.2 * jacobian) * signs(index, 1)
    return Lattice(index, place, np.ones(len(index)), 1 if np.median(strength) > 0 else -1)


def _on_board(lattice: Lattice, board: Charuco) -> Lattice:
    inside = (lattice.index >= 0) & (lattice.index < [board.columns, board.rows])
    return lattice.select(np.asarray(inside.all(axis=1)))
