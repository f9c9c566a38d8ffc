"""Tests that find wrong corners and boards: by their neighbours, by the model, and by each board as a whole."""

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

NEIGHBOURS = 16  # of each corner in the image, itself included
LOCAL_LIMIT = 6.0  # robust standard deviations from the residual of the neighbours
OUTLIER_LIMIT = 4.5  # standard deviations: one in 25 000 good corners lies farther out
MAX_OUTLIER_SHARE = 0.3  # of a board's corners
MAX_RESIDUAL_RATIO = 3.0  # of a board's residuals to those of all


def usable_views(views: Iterable[Corners], board: Board, mirrored: bool) -> tuple[list[Corners], dict[str, str]]:
    """The views that can enter the solve, and the others by name with the reason; of repeated views the first one."""
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
    """Why ``view`` cannot be used; empty where it can."""
    if len(view) < FEWEST_CORNERS:
        return f"{len(view)} corners, {FEWEST_CORNERS} are needed" if view.found else view.reason or "no board"
    lattice = view.lattice(board)
    if np.linalg.matrix_rank(lattice - lattice.mean(axis=0), tol=1e-6) < 2:
        return "all corners on one line"
    if numbered_backwards(view, board, mirrored):
        return "numbered as a reflection of the others: one axis is reversed"
    return ""


def locally_consistent(residual: Floats, seen: Observations) -> Bools:
    """Mask (N,) of the corners whose ``residual`` (N, 2) is about that of their neighbours in the image.

    What a trend does not explain is smooth, so neighbours share it; the error of a wrong corner is shared by none.
    """
    count = min(NEIGHBOURS, len(residual))
    near = cKDTree(seen.image).query(seen.image, k=count)[1]
    excess = lengths(residual - np.median(residual[near], axis=1), seen.weight)
    local = np.median(excess[near], axis=1)
    scale = np.maximum(local, np.median(excess)) / np.median(excess) * robust_scale(excess)
    return np.asarray(excess <= LOCAL_LIMIT * scale)


def consistent(residual: Floats, noise: float, seen: Observations) -> Bools:
    """Mask (N,) of the corners within :data:`OUTLIER_LIMIT` of the finished model, given its ``residual`` (N, 2)."""
    return np.asarray(lengths(residual, seen.weight) <= OUTLIER_LIMIT * noise)


def with_enough(seen: Observations, keep: Bools) -> Bools:
    """``keep`` (N,) without the boards that have too few corners left."""
    return np.asarray(keep & (seen.sums(keep.astype(float)) >= FEWEST_CORNERS)[seen.view])


def misfitting_boards(residual: Floats, noise: float, seen: Observations) -> dict[int, str]:
    """Indices of the boards that do not fit the model as a whole, with the reason."""
    length = np.nan_to_num(lengths(residual, seen.weight) / noise, nan=np.inf)
    far = seen.sums((length > OUTLIER_LIMIT).astype(float)) / seen.sums(np.ones(len(length)))
    found = {}
    for k, rows in enumerate(seen.slices()):
        ratio = robust_scale(length[rows])
        if far[k] > MAX_OUTLIER_SHARE or ratio > MAX_RESIDUAL_RATIO:
            found[k] = (
                f"{100 * far[k]:.0f} % of its corners lie more than {OUTLIER_LIMIT:g} standard deviations off, and its "
                f"residuals are {ratio:.1f} times those of the others: it moved during the exposure, or its corners "
                "are numbered wrongly"
            )
    return found
