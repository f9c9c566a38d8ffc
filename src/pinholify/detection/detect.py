"""One image to the corners of one board."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Floats
from pinholify.board import AprilGrid, Board, Charuco, Checkerboard, CircleGrid, Screen, size
from pinholify.corners import Corners, not_found
from pinholify.detection.aprilgrid import detect_aprilgrid
from pinholify.detection.candidates import find_candidates
from pinholify.detection.charuco import detect_charuco
from pinholify.detection.circles import detect_circles
from pinholify.detection.growth import FEWEST, Grower, grower
from pinholify.detection.intensity import Grey, grey_levels, reduced
from pinholify.detection.lattice import Lattice
from pinholify.detection.merging import merged
from pinholify.detection.placement import ends, place
from pinholify.detection.refine import refine_lattice
from pinholify.errors import BoardError

SMALLEST_SIDE = 24
"""Below this (px) no board can show its corners."""

FAR_LARGER = 2
"""Times the square of a board's longer side: a lattice of more corners shows a larger pattern, however it goes on."""

LARGEST = 4000
"""Corners of the largest board whose size can be told."""

FIRST_SIDE = 1400
"""The search starts on an image reduced by powers of two to at most this width and height (px)."""


def detect_board(image: NDArray[Any], board: Board, *, name: str = "", mirrored: bool = False) -> Corners:
    """The corners of ``board`` in ``image``, with ids in the order of :mod:`pinholify.detection.lattice`.

    ``image``: (height, width) or (height, width, 3) in BGR, uint8, uint16 or float. ``mirrored``: the image
    is a reflection. A part of the board is found too; where its place on the board cannot be known, the
    result says so. Of several boards the largest complete one counts, then the part with the most corners.
    Where no board is found the result has no corners and a ``reason``. Raises BoardError for a screen of Gray codes.
    """
    if isinstance(board, Screen):
        raise BoardError(
            f"one image does not tell the nodes of the screen {board.spec}: decode captures of all its patterns with "
            "'pinholify gray-code decode', and give its table with --corners"
        )
    height, width = image.shape[:2]
    if min(height, width) < SMALLEST_SIDE:
        return not_found(name, f"the image is only {width}x{height} px, too small to show a board")
    if isinstance(board, Charuco):
        return detect_charuco(image, board, name=name)
    if isinstance(board, AprilGrid):
        return detect_aprilgrid(image, board, name=name)
    if isinstance(board, CircleGrid):
        return detect_circles(image, board, name=name, mirrored=mirrored)
    grey = grey_levels(image)
    best = not_found(name, f"no board of {board.spec} inner corners was found")
    most = FAR_LARGER * max(board.columns, board.rows) ** 2
    for lattices in _searches(grey, most):
        for lattice in lattices:
            found = place(grey, lattice, board, name=name, mirrored=mirrored)
            best = _better(best, found)
        if len(best) == size(board):
            break
    return best


def detect_size(image: NDArray[Any]) -> Checkerboard | None:
    """The size of the largest checkerboard in ``image`` that is seen to end on all four sides, columns ≥
    rows.
    """
    grey = grey_levels(image)
    if min(grey.shape) < SMALLEST_SIDE:
        return None
    for lattices in _searches(grey, LARGEST):
        for lattice in sorted(lattices, key=len, reverse=True):
            lattice = lattice.at_origin()
            seen = ends(grey, lattice)
            if min(lattice.extent) >= 3 and seen.left and seen.right and seen.top and seen.bottom:
                return Checkerboard(max(lattice.extent), min(lattice.extent))
    return None


def _searches(grey: Grey, most: int) -> Iterator[list[Lattice]]:
    """The lattices in ``grey``, searched at one size after the other: the quick one, finer ones, a coarser
    one.

    Of those that have more than ``most`` corners only the one of the largest area is among them, as far as it was
    grown.
    """
    levels = 0
    while max(grey.shape) / 2**levels > FIRST_SIDE:
        levels += 1
    for level in [*range(levels, -1, -1), levels + 1]:
        smaller = reduced(grey, level)
        if min(smaller.shape) >= SMALLEST_SIDE:
            found = _grown(grower(smaller, find_candidates(smaller), most=most))
            refined = [refine_lattice(grey, _enlarged(lattice, 2**level)) for lattice in found]
            yield [lattice for lattice in refined if len(lattice) >= FEWEST]


def _grown(growing: Grower) -> list[Lattice]:
    """What grows, and what grows from its parts put together; of what is too large only that of the largest area."""
    lattices = list(growing.lattices())
    lattices += [growing.grow(whole) for whole in merged([part for part in lattices if len(part) <= growing.most])]
    too_large = [lattice for lattice in lattices if len(lattice) > growing.most]
    largest = sorted(too_large, key=lambda lattice: _area(lattice.uv))[-1:]
    return [lattice for lattice in lattices if len(lattice) <= growing.most] + largest


def _area(uv: Floats) -> float:
    """Of the rectangle of image columns and rows around ``uv`` (n, 2) px, in px²."""
    return float(np.prod(np.ptp(uv, axis=0)))


def _enlarged(lattice: Lattice, factor: int) -> Lattice:
    return Lattice(lattice.index, (lattice.uv + 0.5) * factor - 0.5, lattice.weights, lattice.phase)


def _better(best: Corners, found: Corners) -> Corners:
    """The one with more corners; between full boards the larger in the image; a reason with a size beats one
    without.
    """
    if len(found) == len(best) and found.found:
        return max(best, found, key=lambda corners: _area(corners.uv))
    if found.found or best.found:
        return max(best, found, key=len)
    return found
