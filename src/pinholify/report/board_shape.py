"""The board's own shape, as the joint solve found it: how its corners differ from a flat lattice of squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.board import lattice
from pinholify.calibration.result import Calibration
from pinholify.report.numerals import round_down

MAX_ARROW_LENGTH = 0.8  # of the distance between the corners drawn
MAX_CORNERS_PER_SIDE = 24  # corners drawn along each side of the board
FLAT = 1e-9  # squares


@dataclass(frozen=True, slots=True, eq=False)
class BoardShape:
    """Corners of the board at ``places`` (n, 2) in squares, and how far they are from the nearest lattice of squares.

    ``shifts`` (n, 2) in squares are in the board's plane, drawn ``magnification`` times as long; ``heights`` (n,) in
    squares are from the nearest plane, away from the camera positive. ``shift_rms`` and ``height_range`` in squares
    describe all corners, also those left out of the drawing; ``square_mm`` is the side of a square if known.
    """

    places: Floats
    shifts: Floats
    heights: Floats
    magnification: float
    shift_rms: float
    height_range: float
    square_mm: float | None


def board_shape_of(calibration: Calibration) -> BoardShape | None:
    """The shape in ``calibration``; None for a flat board of perfect squares."""
    board = calibration.corner_set.board
    places, points = lattice(board), calibration.board_points
    shifts, heights = _from_similar(places, points[:, :2]), _from_plane(places, points[:, 2])
    length = np.linalg.norm(shifts, axis=1)
    if max(length.max(), np.abs(heights).max()) <= FLAT:
        return None
    every = -(-max(board.columns, board.rows) // MAX_CORNERS_PER_SIDE)
    row, column = np.divmod(np.arange(len(places)), board.columns)
    drawn = (row % every == 0) & (column % every == 0)
    longest = max(float(length[drawn].max()), FLAT)
    return BoardShape(
        places[drawn],
        shifts[drawn],
        heights[drawn],
        round_down(MAX_ARROW_LENGTH * every / longest),
        float(np.sqrt((length**2).mean())),
        float(np.ptp(heights)),
        calibration.square_mm,
    )


def _from_similar(places: Floats, points: Floats) -> Floats:
    """What the best similarity of ``places`` (n, 2) leaves at ``points`` (n, 2)."""
    z, w = (each[:, 0] + 1j * each[:, 1] for each in (places - places.mean(axis=0), points - points.mean(axis=0)))
    left = w - z * (np.vdot(z, w) / np.vdot(z, z))
    return np.stack([left.real, left.imag], axis=1)


def _from_plane(places: Floats, heights: Floats) -> Floats:
    """What the best plane over ``places`` (n, 2) leaves of ``heights`` (n,)."""
    plane = np.column_stack([np.ones(len(places)), places])
    return np.asarray(heights - plane @ np.linalg.lstsq(plane, heights, rcond=None)[0])
