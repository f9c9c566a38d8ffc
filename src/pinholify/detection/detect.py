"""One image to the corners of one board."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from pinholify.board import Board
from pinholify.corners import Corners, not_found
from pinholify.detection.intensity import grey_levels
from pinholify.detection.lattice import orient, turns
from pinholify.detection.opencv import find_complete

SMALLEST_SIDE = 24
"""Below this (px) no board can show its corners."""


def detect_board(image: NDArray[Any], board: Board, *, name: str = "", mirrored: bool = False) -> Corners:
    """The corners of ``board`` in ``image``, with ids in the order of :mod:`pinholify.detection.lattice`.

    ``image``: (height, width) or (height, width, 3) in BGR, uint8, uint16 or float. ``mirrored``: the image
    is a reflection. Where no board is found the result has no corners and a ``reason``.
    """
    grey = grey_levels(image)
    height, width = grey.shape
    if min(height, width) < SMALLEST_SIDE:
        return not_found(name, f"the image is only {width}x{height} px, too small to show a board")
    lattice = find_complete(grey, board)
    if lattice is None:
        return not_found(name, f"no board of {board.spec} inner corners was found")
    size = (board.columns, board.rows)
    ways = [way.at_origin() for way in turns(lattice, mirrored=mirrored) if way.extent == size]
    if not ways:
        return not_found(name, f"a board of {board.spec} inner corners was found, but not its outer lines")
    chosen, assumed = orient(ways, board)
    return Corners(name, chosen.ids(board), chosen.uv, chosen.weights, orientation_assumed=assumed)
