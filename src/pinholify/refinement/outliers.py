"""Corners and boards that are wrong: found by what their neighbours say, and named with the reason."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Bools, Floats
from pinholify.board import Board
from pinholify.calibration.numbering import FEWEST_CORNERS, numbered_backwards
from pinholify.corners import SAME, Corners, repeated
from pinholify.refinement.observations import Observations
from pinholify.refinement.solver import lengths, robust_scale

NEIGHBOURS = 16
LOCAL_LIMIT = 6.0  # robust standard deviations from what the neighbours leave
OUTLIER_LIMIT = 4.5  # standard deviations: one in 25 000 honest corners lies farther out
MAX_OUTLIER_SHARE = 0.3  # of a board's corners beyond the limit
MAX_RESIDUAL_RATIO = 3.0  # of a board's residuals to those of all


def usable_views(views: Iterable[Corners], board: Board, mirrored: bool) -> tuple[list[Corners], dict[str, str]]:
    """The views that may enter the solve, and the others with the reason; of those with the same corners the first."""
    every = list(views)
    usable, unusable, repeats = [], {}, repeated(every)
    for view in every:
        reason = f"{SAME} {repeats[view.name]}" if view.name in repeats else _unusable(view, board, mirrored)
        if reason:
            unusable[view.name] = reason
        else:
            usable.append(view)
    return usable, unusable


def _unusable(view: Corners, board: Board, mirrored: bool) -> str:
    if len(view) < FEWEST_CORNERS:
        return f"{len(view)} corners, {FEWEST_CORNERS} are needed" if view.found else view.reason or "no board"
    lattice = view.lattice(board)
    if np.linalg.matrix_rank(lattice - lattice.mean(axis=0), tol=1e-6) < 2:
        return "all corners on one line"
    if numbered_backwards(view, board, mirrored):
        return "numbered as a reflection of the others: one axis is reversed"
    return ""


def locally_consistent(residual: Floats, seen: Observations) -> Bools:
    """Which corners (N,) leave about the ``residual`` (N, 2) that their neighbours in the image leave.

    What a trend does not explain is smooth, so neighbours share it; a wrong corner shares it with nobody.
    """
    count = min(NEIGHBOURS, len(residual))
    near = cKDTree(seen.image).query(seen.image, k=count)[1]
    excess = lengths(residual - np.median(residual[near], axis=1), seen.weight)
    local = np.median(excess[near], axis=1)
    scale = np.maximum(local, np.median(excess)) / np.median(excess) * robust_scale(excess)
    return np.asarray(excess <= LOCAL_LIMIT * scale)


def consistent(residual: Floats, noise: float, seen: Observations) -> Bools:
    """Which corners (N,) lie within the limit of what the finished model predicts."""
    return np.asarray(lengths(residual, seen.weight) <= OUTLIER_LIMIT * noise)


def with_enough(seen: Observations, keep: Bools) -> Bools:
    """``keep`` (N,) without the boards of which too few corners remain."""
    return np.asarray(keep & (seen.sums(keep.astype(float)) >= FEWEST_CORNERS)[seen.view])


def misfitting_boards(residual: Floats, noise: float, seen: Observations) -> dict[int, str]:
    """Boards by index that as a whole do not fit the model, with the reason."""
    length = np.nan_to_num(lengths(residual, seen.weight) / noise, nan=np.inf)
    far = seen.sums((length > OUTLIER_LIMIT).astype(float)) / seen.sums(np.ones(len(length)))
    found = {}
    for k, rows in enumerate(seen.slices()):
        ratio = robust_scale(length[rows])
        if far[k] > MAX_OUTLIER_SHARE or ratio > MAX_RESIDUAL_RATIO:
            found[k] = (
                f"{far[k]:.0%} of its corners lie more than {OUTLIER_LIMIT:g} standard deviations off, its residuals are "
                f"{ratio:.1f} times those of the others: it moved while exposing, or is numbered wrongly"
            )
    return found
