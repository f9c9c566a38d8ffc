"""Checkerboards: lattices grown from saddle points, refined, and placed on the board."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Floats
from pinholify.board import Board, Checkerboard, size
from pinholify.corners import Corners, not_found
from pinholify.detection.candidates import find_candidates
from pinholify.detection.growth import MIN_LATTICE_CORNERS, Grower, grower
from pinholify.detection.intensity import MIN_SIDE_PX, Grey, grey_levels, halvings, reduced
from pinholify.detection.lattice import Lattice
from pinholify.detection.merging import merged
from pinholify.detection.placement import ends, place
from pinholify.detection.refine import refine_lattice

FAR_LARGER = 2
"""A lattice of more corners than this times the square of the board's longer side shows a larger pattern."""

MAX_BOARD_CORNERS = 4000
"""Corners of the largest board whose size is determined."""

FIRST_SIDE = 1400
"""The search starts on an image reduced by powers of two to at most this width and height (px)."""


def detect_checkerboard(image: NDArray[Any], board: Board, *, name: str, mirrored: bool) -> Corners:
    """The inner corners of ``board`` in ``image``; arguments and result as in :func:`detect_board`."""
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
    """The size of the largest checkerboard in ``image`` whose four margins are all visible, columns ≥ rows."""
    grey = grey_levels(image)
    if min(grey.shape) < MIN_SIDE_PX:
        return None
    for lattices in _searches(grey, MAX_BOARD_CORNERS):
        for lattice in sorted(lattices, key=len, reverse=True):
            lattice = lattice.at_origin()
            seen = ends(grey, lattice)
            if min(lattice.extent) >= 3 and seen.left and seen.right and seen.top and seen.bottom:
                return Checkerboard(max(lattice.extent), min(lattice.extent))
    return None


def _searches(grey: Grey, most: int) -> Iterator[list[Lattice]]:
    """The lattices in ``grey``, one list per resolution searched: the fastest first, then finer ones, then a coarser.

    Of the lattices of more than ``most`` corners only that of the largest area is kept, as far as it was grown.
    """
    levels = halvings(grey, FIRST_SIDE)
    for level in [*range(levels, -1, -1), levels + 1]:
        smaller = reduced(grey, level)
        if min(smaller.shape) >= MIN_SIDE_PX:
            found = _grown(grower(smaller, find_candidates(smaller), most=most))
            refined = [refine_lattice(grey, _enlarged(lattice, 2**level)) for lattice in found]
            yield [lattice for lattice in refined if len(lattice) >= MIN_LATTICE_CORNERS]


def _grown(growing: Grower) -> list[Lattice]:
    """All grown lattices, those grown from joined parts, and of the too large ones that of the largest area."""
    lattices = list(growing.lattices())
    lattices += [growing.grow(whole) for whole in merged([part for part in lattices if len(part) <= growing.most])]
    too_large = [lattice for lattice in lattices if len(lattice) > growing.most]
    largest = sorted(too_large, key=lambda lattice: _area(lattice.uv))[-1:]
    return [lattice for lattice in lattices if len(lattice) <= growing.most] + largest


def _area(uv: Floats) -> float:
    """Area in px² of the upright rectangle around the pixels ``uv`` (n, 2)."""
    return float(np.prod(np.ptp(uv, axis=0)))


def _enlarged(lattice: Lattice, factor: int) -> Lattice:
    return lattice.moved((lattice.uv + 0.5) * factor - 0.5)


def _better(best: Corners, found: Corners) -> Corners:
    """The result with more corners; of equal ones the larger in the image; of two reasons the later one."""
    if len(found) == len(best) and found.found:
        return max(best, found, key=lambda corners: _area(corners.uv))
    if found.found or best.found:
        return max(best, found, key=len)
    return found
