"""Straightness: a board's rows and columns in the photograph and in the virtual plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.observation import MappedBoard
from pinholify.evaluation.measures import board_lines, collinearity_errors, line_feet
from pinholify.evaluation.summary import Evaluation
from pinholify.geometry import convex_hull
from pinholify.report.numerals import round_down

DRAWN_BEND = 0.06  # largest deviation from a straight line as drawn, as a fraction of the drawing's longer side


@dataclass(frozen=True, slots=True, eq=False)
class Bends:
    """Lines of a board, each (n, 2), scaled to a unit square: the ``straight`` fits, and the lines as ``bent``."""

    straight: tuple[Floats, ...]
    bent: tuple[Floats, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Straightness:
    """Collinearity errors (RMS distance from a line ÷ its length), and one board's lines before and after.

    ``ce`` is the error in the virtual plane, ``image_ce`` that of the same boards in the photographs. ``before`` and
    ``after`` show the board of photograph ``example`` in the image and in the virtual plane, both with deviations
    ``magnification`` times as large.
    """

    ce: float
    ce_without_reference: float
    image_ce: float
    example: str
    magnification: float
    before: Bends
    after: Bends


def straightness_of(evaluation: Evaluation) -> Straightness:
    """Collinearity errors of all counted boards, drawn for the reference or else the largest board."""
    boards = [observed.board for observed in evaluation.observed.values()]
    in_image = np.concatenate([collinearity_errors(board.lattice, board.uv) for board in boards])
    reference = evaluation.calibration.reference
    example = max(boards, key=lambda board: (board.name == reference, convex_hull(board.uv).area))
    magnification = _magnification(example)
    return Straightness(
        evaluation.pooled.ce,
        evaluation.pooled_without_reference.ce,
        float(in_image.mean()),
        example.name,
        magnification,
        _bends(example.lattice, example.uv, magnification),
        _bends(example.lattice, example.xy, magnification),
    )


def _magnification(board: MappedBoard) -> float:
    """The magnification that makes the worst line of the photograph clearly bent and still a line."""
    bends = _bends(board.lattice, board.uv, 1.0)
    pairs = zip(bends.straight, bends.bent, strict=True)
    worst = max(float(np.linalg.norm(bent - straight, axis=1).max()) for straight, bent in pairs)
    return max(1.0, round_down(DRAWN_BEND / worst)) if worst > 0 else 1.0


def _bends(lattice: Floats, points: Floats, magnification: float) -> Bends:
    low, high = points.min(axis=0), points.max(axis=0)
    scale = float((high - low).max())
    straight, bent = [], []
    for line in board_lines(lattice, points):
        foot = line_feet(line)
        straight.append((foot - low) / scale)
        bent.append((foot + magnification * (line - foot) - low) / scale)
    return Bends(tuple(straight), tuple(bent))
