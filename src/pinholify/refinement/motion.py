"""The motion of boards under a rolling shutter: how large it is, from the residuals that no pose explains.

A sensor that is read row by row sees the lower part of the board later than the upper one. If camera or board is
hand-held, each photograph is sheared and stretched by its own motion, which over few photographs looks like pixels that
are not square, or like another focal length. The motions are unknowns of each board, like its pose, with a Gaussian
prior of mean zero (the mixed model of Laird & Ware 1982). Here their standard deviation is found, by restricted
likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Floats
from pinholify.geometry import POSE_DOF
from pinholify.refinement.observations import Observations
from pinholify.refinement.solver import Solution

MIN_GAIN = 3.0  # nats by which motions must raise the likelihood; boards that stand still gain almost none
CALM_SHARE = 0.85  # of the boards: those that seem to move least
MIN_CALM_GAIN = 1.5  # nats by which the motions of those boards alone must raise it
CANDIDATE_STDS = np.geomspace(0.01, 1e4, 120)  # of motions, in units of the noise per normalised unit of the image


def motion_of(solution: Solution, seen: Observations) -> float:
    """The standard deviation of motions in units of the noise; 0 where the likelihood does not favour motions.

    It is that of the boards' residuals with everything that they share fixed at ``solution``. Where only a few boards
    move it is 0 too: the others, which stand still, determine the camera better without motions of their own.
    """
    moments = [_along_motions(board) for board in _boards(solution, seen)]
    squares, spreads, pulls = (np.array(each) for each in zip(*moments, strict=True))
    free = 2.0 * seen.sums(np.ones(len(seen.view))) - POSE_DOF
    share = (pulls**2).sum(axis=1) / squares * free
    calm = np.argsort(share)[: int(CALM_SHARE * len(share))]
    if not _best(squares[calm], spreads[calm], pulls[calm], float(free[calm].sum()))[1] >= MIN_CALM_GAIN:
        return 0.0
    std, gain = _best(squares, spreads, pulls, float(free.sum()))
    return std if gain > MIN_GAIN else 0.0


def _best(squares: Floats, spreads: Floats, pulls: Floats, free: float) -> tuple[float, float]:
    """The most likely standard deviation, with the noise fitted along with it, and the nats that it gains.

    The gain is not a number where nothing is left to explain.
    """
    variances = CANDIDATE_STDS[:, None, None] ** 2 * spreads  # along each board's own axes, in units of the noise's
    explained = (variances / (1.0 + variances) * pulls**2).sum(axis=(1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = free * np.log(squares.sum() / (squares.sum() - explained)) - np.log1p(variances).sum(axis=(1, 2))
    best = int(gain.argmax())
    return float(CANDIDATE_STDS[best]), 0.5 * float(gain[best])


def motion_rms(solution: Solution, seen: Observations) -> float:
    """RMS per axis, in normalised image units, of the shifts of corners by motions that no pose can absorb."""
    squares = 0.0
    for board, motion, rows in zip(_boards(solution, seen), solution.state.motions, seen.slices(), strict=True):
        shifts = (board.moved @ motion).reshape(-1, 2) / seen.weight[rows, None]
        squares += float((shifts**2).sum())
    return float(np.sqrt(squares / (2.0 * len(seen.view))))


@dataclass(frozen=True, slots=True, eq=False)
class _Board:
    """One board with all that a change of its pose can absorb projected out.

    ``residual`` (2n,) is that of the board without motion, ``moved`` (2n, 3) its derivative by the motion; both are
    multiplied by the corners' weights.
    """

    residual: Floats
    moved: Floats


def _boards(solution: Solution, seen: Observations) -> list[_Board]:
    model = solution.model if solution.model.motion else replace(solution.model, motion=1.0)
    pose = model.linearise(solution.state, seen, solution.prediction).pose * seen.weight[:, None, None]
    residual = solution.prediction.residual * seen.weight[:, None]
    found = []
    for rows, motion in zip(seen.slices(), solution.state.motions, strict=True):
        own = pose[rows].reshape(-1, pose.shape[2])
        still = np.column_stack([residual[rows].ravel() + own[:, POSE_DOF:] @ motion, own[:, POSE_DOF:]])
        basis = np.linalg.qr(own[:, :POSE_DOF])[0]
        still -= basis @ (basis.T @ still)
        found.append(_Board(still[:, 0], still[:, 1:]))
    return found


def _along_motions(board: _Board) -> tuple[float, Floats, Floats]:
    """The sum of squares, and along the principal axes of ``moved`` its squared size (3,) and the residual (3,)."""
    axes, singular, _ = np.linalg.svd(board.moved, full_matrices=False)
    return float(board.residual @ board.residual), singular**2, axes.T @ board.residual
