"""Boards counted the other way round: found by their handedness, and renumbered.

A camera sees every board from its front, so the lattices of all views have one handedness in the image. A view whose
lattice has the other one was counted with one axis reversed. No residual tells: a flat board counted that way round
fits as well as ever, as if it were seen from behind. Renumbered it says as much of the camera as any other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Floats
from pinholify.board import Board, lattice, outline
from pinholify.corners import Corners, CornerSet
from pinholify.errors import InputError

FEWEST_CORNERS = 6
AXES = ("columns", "rows")


class Numbered(NamedTuple):
    """Corners whose boards are all counted the same way round, and what was done to which view."""

    corner_set: CornerSet
    notes: Mapping[str, str]


def numbered_alike(corner_set: CornerSet, mirrored: bool) -> Numbered:
    """``corner_set`` with the boards renumbered that were counted the other way round; ``mirrored`` says that the
    images are reflections. Corners keep their order. Boards that have no such symmetry stay as they are.
    """
    views, notes = [], {}
    for view in corner_set.views:
        if counted_backwards(view, corner_set.board, mirrored):
            for axis in _likely_axes(view, corner_set.board, mirrored):
                other = _reversed(view, corner_set.board, axis)
                if other is not None:
                    view = other
                    notes[view.name] = f"counted the other way round: its {AXES[axis]} were reversed"
                    break
        views.append(view)
    return Numbered(corner_set.with_views(views), notes)


def check_most_count_alike(corner_set: CornerSet, mirrored: bool) -> None:
    """Raise InputError where half of the boards or more are counted the other way round: it is not the boards then."""
    found = corner_set.found
    backwards = [view for view in found if counted_backwards(view, corner_set.board, mirrored)]
    if backwards and 2 * len(backwards) >= len(found):
        hand, needed = ("right", "left") if mirrored else ("left", "right")
        remedy = "leave --mirrored out" if mirrored else "say --mirrored if the camera looks into a mirror"
        raise InputError(
            f"{len(backwards)} of {len(found)} boards are numbered {hand}-handed as seen in the image and "
            f"{needed}-handed is expected: {remedy}, or number x to the right and y down"
        )


def counted_backwards(view: Corners, board: Board, mirrored: bool) -> bool:
    """Whether the lattice of ``view`` has the handedness that no camera sees; False where too few corners tell."""
    points = view.lattice(board)
    if len(points) < FEWEST_CORNERS or np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-6) < 2:
        return False
    return (handedness(view, board) < 0) != mirrored


def handedness(view: Corners, board: Board) -> float:
    """Determinant of the best affine map from lattice to image: negative where the image shows a reflection."""
    return float(np.linalg.det(_affine(view, board)))


def _affine(view: Corners, board: Board) -> Floats:
    """The best one's linear part (2, 2): what a square along x, and one along y, is in the image."""
    points = view.lattice(board)
    return np.asarray(np.linalg.lstsq(points - points.mean(axis=0), view.uv - view.uv.mean(axis=0), rcond=None)[0])


def _likely_axes(view: Corners, board: Board, mirrored: bool) -> tuple[int, int]:
    """The axis first whose reversal makes x run to the right and y down (in a mirror: to the left); then the other,
    which differs by half a turn.
    """
    affine = _affine(view, board)
    rightwards = -affine[0, 0] if mirrored else affine[0, 0]
    return (0, 1) if rightwards < affine[1, 1] else (1, 0)


def _reversed(view: Corners, board: Board, axis: int) -> Corners | None:
    """``view`` counted from the other end of ``axis``; None where the board has no points there."""
    first, last = outline(board)
    points = view.lattice(board)
    points[:, axis] = (first + last)[axis] - points[:, axis]
    distance, ids = cKDTree(lattice(board)).query(points)
    return replace(view, ids=ids) if distance.max() < 1e-6 else None
