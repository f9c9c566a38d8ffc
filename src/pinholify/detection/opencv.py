"""OpenCV's two chessboard detectors, coarse to fine, as a finder of complete boards.

They run on reduced images first, so that a large photograph is quick and never hangs; positions are then ours
(:mod:`pinholify.detection.saddle`), fitted at full size.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Floats
from pinholify.board import Board
from pinholify.detection.intensity import Grey, stretched
from pinholify.detection.lattice import Lattice
from pinholify.detection.saddle import refine_saddles

LONG_SIDES = (640, 1280)
"""Sizes (px) of the reduced images; squares that drown in the smaller one show in the larger."""

WINDOW = 0.25
"""Half window of the saddle fit, as a fraction of the local spacing; within 3 to 20 px."""


def find_complete(grey: Grey, board: Board) -> Lattice | None:
    """All corners of ``board`` in ``grey`` as a lattice, by OpenCV's detectors, or None."""
    picture = stretched(grey)
    scales = sorted({min(1.0, side / max(picture.shape)) for side in LONG_SIDES})
    for scale in scales:
        small = picture
        if scale < 1.0:
            small = np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
        for detector in (_classic, _sector_based):
            grid = detector(small, board)
            if grid is not None:
                return _refined(grey, (grid + 0.5) / scale - 0.5)
    return None


def _classic(picture: NDArray[Any], board: Board) -> Floats | None:
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    return _grid(*cv2.findChessboardCorners(picture, (board.columns, board.rows), flags=flags), board)


def _sector_based(picture: NDArray[Any], board: Board) -> Floats | None:
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE
    return _grid(*cv2.findChessboardCornersSB(picture, (board.columns, board.rows), flags=flags), board)


def _grid(found: bool, corners: Any, board: Board) -> Floats | None:
    """(rows, columns, 2) float64, columns counted so that the lattice turns clockwise."""
    if not found:
        return None
    grid = np.asarray(corners, dtype=np.float64).reshape(board.rows, board.columns, 2)
    across, down = grid[:, -1] - grid[:, 0], (grid[-1] - grid[0]).mean(axis=0)
    turn = np.sum(across[:, 0] * down[1] - across[:, 1] * down[0])
    return grid if turn > 0 else grid[:, ::-1]


def _refined(grey: Grey, grid: Floats) -> Lattice:
    rows, columns, _ = grid.shape
    frames = np.stack([np.gradient(grid, axis=1), np.gradient(grid, axis=0)], axis=-1).reshape(-1, 2, 2)
    spacing = np.linalg.norm(frames, axis=1).min(axis=1)
    radius = np.clip(WINDOW * spacing, 3.0, 20.0)
    saddles = refine_saddles(grey, grid.reshape(-1, 2), frames * (radius / spacing)[:, None, None])
    row, column = np.divmod(np.arange(rows * columns), columns)
    phase = 1 if np.sum(saddles.strength * (-1.0) ** (row + column)) > 0 else -1
    index, kept = np.stack([column, row], axis=1)[saddles.sound], saddles.uv[saddles.sound]
    return Lattice(index, kept, np.ones(len(kept)), phase)
