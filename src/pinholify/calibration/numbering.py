"""Boards numbered with the wrong handedness: found, and renumbered; and those numbered as on a board of another size.

A camera sees every board from its front, so the lattices of all views have the same handedness in the image. A view
whose lattice has the opposite one was numbered with one axis reversed. No residual shows that: a flat board so numbered
fits equally well, as if seen from behind. Renumbered, it is as useful as any other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Floats
from pinholify.board import Board, Checkerboard, CircleGrid, lattice, outline
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CalibrationError, InputError
from pinholify.geometry import apply_homography, estimate_homography

CHECKED_VIEWS = 3  # with the most corners, by which the board's size is checked
MAX_MISFIT = 0.3  # of the distance between neighbouring corners: beyond it other sizes of the board are tried
MIN_MISFIT_RATIO = 4.0  # of the misfit of the given size to that of another one: beyond it the given one is wrong
FEWEST_CORNERS = 6  # of a view, to determine a pose and to show its handedness
AXES = ("columns", "rows")


class Numbered(NamedTuple):
    """Corners whose boards all have one handedness, and by view name what was done to those that had the other."""

    corner_set: CornerSet
    notes: Mapping[str, str]


def numbered_alike(corner_set: CornerSet, mirrored: bool) -> Numbered:
    """``corner_set`` with the boards renumbered whose handedness is the wrong one.

    ``mirrored`` means that the images are reflections. Corners keep their order. Boards whose lattice is not symmetric
    in the reversed axis stay unchanged.
    """
    views, notes = [], {}
    for view in corner_set.views:
        if numbered_backwards(view, corner_set.board, mirrored):
            for axis in _likely_axes(view, corner_set.board, mirrored):
                other = _reversed(view, corner_set.board, axis)
                if other is not None:
                    view = other
                    notes[view.name] = f"numbered the other way round ({AXES[axis]} reversed)"
                    break
        views.append(view)
    return Numbered(corner_set.with_views(views), notes)


def check_size(corner_set: CornerSet) -> None:
    """Raise CalibrationError where the corners are numbered as on a board of another size: transposed, or one off."""
    views = sorted(corner_set.found, key=len)[-CHECKED_VIEWS:]
    board = corner_set.board
    misfit = _misfit(views, board)
    if not MAX_MISFIT < misfit < np.inf:
        return
    others = {_misfit(views, other): other for other in _neighbouring_sizes(corner_set)}
    if others and MIN_MISFIT_RATIO * min(others) < misfit:
        other = others[min(others)].spec
        raise CalibrationError(
            f"the corners are numbered as on a {other} board, not {board.spec}: give the board as {other}, or number "
            f"them as on a {board.spec} board"
        )


def _neighbouring_sizes(corner_set: CornerSet) -> list[Board]:
    """Boards on which the same ids are at other places: with columns and rows exchanged, or one column more or less."""
    board = corner_set.board
    if not isinstance(board, Checkerboard | CircleGrid):
        return []
    last = max(int(view.ids.max()) for view in corner_set.found)
    sizes = {(c, max(last // c + 1, 3)) for c in (board.columns - 1, board.columns + 1) if c >= 3}
    return [replace(board, columns=c, rows=r) for c, r in {(board.rows, board.columns), *sizes} if c != board.columns]


def _misfit(views: Sequence[Corners], board: Board) -> float:
    """The median over ``views`` of :func:`_misfit_of`, of those that have one; inf without any."""
    each = [misfit for view in views if np.isfinite(misfit := _misfit_of(view, board))]
    return float(np.median(each)) if each else np.inf


def _misfit_of(view: Corners, board: Board) -> float:
    """What a homography leaves of a typical corner, in distances to the nearest one; not finite where there is none."""
    points = view.lattice(board)
    if len(view) < FEWEST_CORNERS or np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-6) < 2:
        return np.inf
    spacing = np.median(cKDTree(view.uv).query(view.uv, k=2)[0][:, 1])
    with np.errstate(all="ignore"):
        try:
            left = apply_homography(estimate_homography(points, view.uv), points) - view.uv
        except np.linalg.LinAlgError:
            return np.inf
        return float(np.median(np.linalg.norm(left, axis=1)) / spacing)


def check_numbering(corner_set: CornerSet, mirrored: bool) -> None:
    """Raise InputError where at least half of the boards are numbered backwards: then ``mirrored`` must be wrong."""
    found = corner_set.found
    backwards = [view for view in found if numbered_backwards(view, corner_set.board, mirrored)]
    if backwards and 2 * len(backwards) >= len(found):
        raise wrong_handedness(f"{len(backwards)} of {len(found)} boards", mirrored)


def wrong_handedness(what: str, mirrored: bool) -> InputError:
    """The error for ``what``, in the plural, being numbered with the handedness that ``mirrored`` rules out."""
    found, needed = ("right", "left") if mirrored else ("left", "right")
    remedy = "leave 'mirrored' off" if mirrored else "set 'mirrored' if the camera looks into a mirror"
    return InputError(
        f"{what} are numbered {found}-handed as seen in the image, but {needed}-handed is needed: {remedy}, "
        f"or number x to the {needed} and y down"
    )


def numbered_backwards(view: Corners, board: Board, mirrored: bool) -> bool:
    """Whether the lattice of ``view`` has the wrong handedness; False where its corners are too few to show it."""
    points = view.lattice(board)
    if len(points) < FEWEST_CORNERS or np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-6) < 2:
        return False
    return (handedness(view, board) < 0) != mirrored


def handedness(view: Corners, board: Board) -> float:
    """Determinant of the best affine map from lattice to image: negative where the image shows a reflection."""
    return float(np.linalg.det(_affine(view, board)))


def _affine(view: Corners, board: Board) -> Floats:
    """Linear part (2, 2) of that map: the shifts in px of one square along x, and along y."""
    points = view.lattice(board)
    return np.asarray(np.linalg.lstsq(points - points.mean(axis=0), view.uv - view.uv.mean(axis=0), rcond=None)[0])


def _likely_axes(view: Corners, board: Board, mirrored: bool) -> tuple[int, int]:
    """Both axes, the likelier one to be reversed first.

    Its reversal makes x run to the right (in a mirror: to the left) and y down; the other's differs by half a turn.
    """
    affine = _affine(view, board)
    rightwards = -affine[0, 0] if mirrored else affine[0, 0]
    return (0, 1) if rightwards < affine[1, 1] else (1, 0)


def _reversed(view: Corners, board: Board, axis: int) -> Corners | None:
    """``view`` numbered from the other end of ``axis``; None where the board has no points there."""
    first, last = outline(board)
    points = view.lattice(board)
    points[:, axis] = (first + last)[axis] - points[:, axis]
    distance, ids = cKDTree(lattice(board)).query(points)
    return replace(view, ids=ids) if distance.max() < 1e-6 else None
