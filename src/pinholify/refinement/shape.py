"""Boards that are neither flat nor square: a smooth height and a print scale, shared by all views.

Height in squares over the lattice: z = Σ h_j m_j(ξ, υ) with even monomials of ξ, υ ∈ [−1, 1], so that a half
turn of the board, which a picture may not show, changes nothing. Constants and tilts are poses. A print is stretched
along y against x and sheared, as a printer feeds its paper: Y → (1 + ε) Y, X → X + γ Y.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.board import Board, outline

HEIGHT_STD = 0.1  # squares
STRETCH_STD = 0.003  # of ε and of γ
HEIGHTS = 6  # ξ², ξυ, υ², ξ⁴, ξ²υ², υ⁴


@dataclass(frozen=True, slots=True)
class BoardShape:
    """The family of shapes; its parameters η are six heights (squares) where ``bends``, then ε and γ where
    ``stretches``.
    """

    half_columns: float
    half_rows: float
    bends: bool = True
    stretches: bool = True

    @property
    def prior_std(self) -> Floats:
        """Standard deviations of η, whose prior mean is zero."""
        heights = [HEIGHT_STD] * (HEIGHTS if self.bends else 0)
        return np.array(heights + [STRETCH_STD] * (2 * self.stretches))

    def kept(self, smaller: BoardShape) -> Bools:
        """Which of this family's η the ``smaller`` family has too."""
        heights = [smaller.bends] * (HEIGHTS if self.bends else 0)
        return np.array(heights + [smaller.stretches] * (2 * self.stretches), dtype=bool)

    def smaller(self) -> list[BoardShape]:
        """All families within this one, itself first and the flat square board last."""
        pairs = [(b, s) for b in (True, False) for s in (True, False) if b <= self.bends and s <= self.stretches]
        return [replace(self, bends=b, stretches=s) for b, s in pairs]

    def points(self, eta: Floats, lattice: Floats) -> Floats:
        """Points (n, 3) of the board for ``lattice`` (n, 2) from its middle."""
        height = self._monomials(lattice) @ eta[:HEIGHTS] if self.bends else np.zeros(len(lattice))
        x, y = lattice.T
        return np.column_stack([x + self.shear(eta) * y, y * (1.0 + self.stretch(eta)), height])

    def slopes(self, by_point: Floats, lattice: Floats) -> Floats:
        """The derivatives (n, m, η) by η of what has the derivatives ``by_point`` (n, m, 3) by the board's points."""
        slopes = np.empty((*by_point.shape[:2], len(self.prior_std)))
        if self.bends:
            np.multiply(by_point[:, :, 2:], self._monomials(lattice)[:, None], out=slopes[:, :, :HEIGHTS])
        if self.stretches:
            np.multiply(by_point[:, :, 1::-1], lattice[:, 1:, None], out=slopes[:, :, -2:])
        return slopes

    def stretch(self, eta: Floats) -> float:
        """ε: how much longer y's squares are than x's, as a fraction."""
        return float(eta[-2]) if self.stretches else 0.0

    def shear(self, eta: Floats) -> float:
        """γ: how far x's lines lean along x for each square along y, a fraction."""
        return float(eta[-1]) if self.stretches else 0.0

    def height(self, eta: Floats, lattice: Floats) -> Floats:
        """Height (n,) over the plane z = 0 through the board's middle, in squares, away from the camera
        positive.
        """
        return self.points(eta, lattice)[:, 2]

    def _monomials(self, lattice: Floats) -> Floats:
        xi, upsilon = (lattice / [self.half_columns, self.half_rows]).T
        xi2, upsilon2 = xi**2, upsilon**2
        return np.column_stack([xi2, xi * upsilon, upsilon2, xi2**2, xi2 * upsilon2, upsilon2**2])


def board_shape(board: Board) -> BoardShape:
    """All shapes that ``board`` may have."""
    first, last = outline(board)
    half_columns, half_rows = (last - first) / 2.0
    return BoardShape(float(half_columns), float(half_rows))
