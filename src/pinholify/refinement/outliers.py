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
from pinholify.refinement.solver import MIN_NOISE, lengths, robust_scale

NEIGHBOURS = 16  # of each corner in the image, itself included
BOARD_NEIGHBOURS = 8  # of each corner on its board
GROSS_LIMIT = 1.0  # spacings from where the neighbours put a corner; perspective and lenses move it by less
GROSS_ROUNDS = 5  # of reweighted least squares
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


def coherent(seen: Observations) -> Bools:
    """Mask (N,) of the corners without gross errors, which can be told without a camera.

    Such a corner lies far from where its neighbours on the board put it by an affine map of least absolute errors. A
    board with too few corners left keeps all.
    """
    keep = np.ones(len(seen.view), dtype=bool)
    for rows in seen.slices():
        keep[rows] = _near_neighbours(seen.lattice[rows], seen.image[rows])
    enough = seen.sums(keep.astype(float)) >= FEWEST_CORNERS
    return keep | ~enough[seen.view]


def _near_neighbours(lattice: Floats, image: Floats) -> Bools:
    """Mask (n,) of the corners of one board that lie near where their neighbours put them."""
    near = cKDTree(lattice).query(lattice, k=min(BOARD_NEIGHBOURS + 1, len(lattice)))[1][:, 1:]
    design = np.concatenate([lattice[near] - lattice[:, None], np.ones((*near.shape, 1))], axis=2)
    weight = np.ones(near.shape)
    for _ in range(GROSS_ROUNDS):
        weighted = design.transpose(0, 2, 1) * weight[:, None]
        affine = np.linalg.pinv(weighted @ design, hermitian=True) @ (weighted @ image[near])
        weight = 1.0 / np.maximum(np.linalg.norm(design @ affine - image[near], axis=2), MIN_NOISE)
    spacing = np.sqrt(np.abs(np.linalg.det(affine[:, :2])))
    return np.asarray(np.linalg.norm(image - affine[:, 2], axis=1) <= GROSS_LIMIT * np.median(spacing))


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
