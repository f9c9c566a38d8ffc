"""One image to the corners of one board, by the detector of the board's kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from pinholify.board import AprilGrid, Board, Charuco, Checkerboard, CircleGrid, Screen
from pinholify.corners import Corners, not_found
from pinholify.detection.aprilgrid import detect_aprilgrid
from pinholify.detection.charuco import detect_charuco
from pinholify.detection.checkerboard import detect_checkerboard
from pinholify.detection.circles import detect_circles
from pinholify.detection.intensity import MIN_SIDE_PX
from pinholify.errors import BoardError

DETECTORS: dict[type[Board], Callable[..., Corners]] = {
    Checkerboard: detect_checkerboard,
    Charuco: detect_charuco,
    AprilGrid: detect_aprilgrid,
    CircleGrid: detect_circles,
}
"""Detectors by the type of board: ``detector(image, board, name=name, mirrored=mirrored)`` as in :func:`detect_board`.

Boards of other types are looked for as checkerboards.
"""


def detect_board(image: NDArray[Any], board: Board, *, name: str = "", mirrored: bool = False) -> Corners:
    """The corners of ``board`` in ``image``, with ids in the order of :mod:`pinholify.detection.lattice`.

    ``image``: (height, width) or (height, width, 3) in BGR, uint8, uint16 or float. ``mirrored``: the image is a
    reflection; boards with markers detect that themselves. A board that is partly visible is found too; where its
    place on the board cannot be determined, the result is marked. Of several boards the largest complete one is chosen,
    then the part with the most corners.

    Where no board is found the result has no corners and a ``reason``. Raises BoardError for a screen of Gray codes.
    """
    if isinstance(board, Screen):
        raise BoardError(
            f"the nodes of the screen {board.spec} cannot be found in a single image: decode captures of all its "
            "patterns with 'pinholify gray-code decode', and calibrate from the corner table that it writes"
        )
    height, width = image.shape[:2]
    if min(height, width) < MIN_SIDE_PX:
        return not_found(name, f"the image is only {width}x{height} px, too small to show a board")
    detector: Callable[..., Corners] = DETECTORS.get(type(board), detect_checkerboard)
    return detector(image, board, name=name, mirrored=mirrored)
