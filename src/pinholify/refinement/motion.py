"""How much boards move while the shutter rolls, found from what no pose makes good.

A sensor that is read row by row sees the lower part of the board later than the upper one. Where camera or board are
held by hand each photograph is sheared and stretched by its own motion, which over few photographs looks like pixels
that are not square, or like another focal length. The motions are unknowns of each board as its pose is, Gaussian
about none (the mixed model of Laird & Ware 1982); their standard deviation is found here by restricted likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Floats
from pinholify.refinement.model import POSE
from pinholify.refinement.observations import Observations
from pinholify.refinement.solver import Solution

WORTH = 3.0  # nats that motions have to bring for their standard deviation; boards that stand still bring almost none
MOST, OF_MOST = 0.85, 1.5  # of the boards, those that seem to move least, and what they have to bring
STDS = np.geomspace(0.01, 1e4, 120)  # that motions may have, in noises per unit of the image


def motion_of(solution: Solution, seen: Observations) -> float:
    """The standard deviation of motions in units of the noise; 0 where they are not worth it.

    Of the boards' residuals with all that they share held as ``solution`` has it. Where but a few boards move the
    others, which stand still, say more as they are.
    """
    told = [_along_motions(board) for board in _boards(solution, seen)]
    squares, spreads, pulls = (np.array(each) for each in zip(*told, strict=True))
    free = 2.0 * seen.sums(np.ones(len(seen.view))) - POSE
    share = (pulls**2).sum(axis=1) / squares * free
    calm = np.argsort(share)[: int(MOST * len(share))]
    if _best(squares[calm], spreads[calm], pulls[calm], float(free[calm].sum()))[1] < OF_MOST:
        return 0.0
    std, gain = _best(squares, spreads, pulls, float(free.sum()))
    return std if gain > WORTH else 0.0


def _best(squares: Floats, spreads: Floats, pulls: Floats, free: float) -> tuple[float, float]:
    """The most likely standard deviation, with the noise of most likelihood beside it, and the nats that it brings."""
    variances = STDS[:, None, None] ** 2 * spreads  # along each board's own axes, in the noise's
    explained = (variances / (1.0 + variances) * pulls**2).sum(axis=(1, 2))
    gain = free * np.log(squares.sum() / (squares.sum() - explained)) - np.log1p(variances).sum(axis=(1, 2))
    best = int(gain.argmax())
    return float(STDS[best]), 0.5 * float(gain[best])


def motion_rms(solution: Solution, seen: Observations) -> float:
    """What the motions of ``solution`` shift its corners by that no pose makes good: rms an axis, normalised."""
    boards = _boards(solution, seen)
    pairs = zip(boards, solution.state.motions, strict=True)
    return float(np.sqrt(sum(((board.moved @ motion) ** 2).sum() for board, motion in pairs) / (2.0 * len(seen.view))))


@dataclass(frozen=True, slots=True, eq=False)
class _Board:
    """What no pose makes good of a board: the ``residual`` (2n,) as if it stood still, and what its motion adds to it,
    ``moved`` (2n, 3).
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
        still = np.column_stack([residual[rows].ravel() + own[:, POSE:] @ motion, own[:, POSE:]])
        basis = np.linalg.qr(own[:, :POSE])[0]
        still -= basis @ (basis.T @ still)
        found.append(_Board(still[:, 0], still[:, 1:]))
    return found


def _along_motions(board: _Board) -> tuple[float, Floats, Floats]:
    """The sum of squares, and along the axes of what it tells of its motion: how much (3,), and the residual (3,)."""
    axes, singular, _ = np.linalg.svd(board.moved, full_matrices=False)
    return float(board.residual @ board.residual), singular**2, axes.T @ board.residual
