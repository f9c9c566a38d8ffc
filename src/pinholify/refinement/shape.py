"""Boards that are neither flat nor square: a smooth shape shared by all views, linear in its parameters η.

Three parts, each with or without. *Bend*: a height z = Σ η_j m_j(ξ, υ) with even monomials of ξ, υ ∈ [−1, 1], so that a
half turn of the board, which a picture may not show, changes nothing. *Stretch*: a print longer along y than along x,
and sheared, as a printer feeds its paper: Y → (1 + ε) Y, X → X + γ Y. *Warp*: smooth shifts of all corners, along x, y
and z, whatever form they have. Constants, turns and tilts are poses, the scale of a square is the unit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain, product

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import Board, Screen, lattice
from pinholify.refinement.observations import Observations, lattice_middle
from pinholify.refinement.surface import surface_functions

HEIGHT_STD = 0.1  # squares
STRETCH_STD = 0.003  # of ε and of γ
BEND, STRETCH, WARP = "bend", "stretch", "warp"
OPTIONAL = (BEND, STRETCH)


@dataclass(frozen=True, slots=True, eq=False)
class BoardShape:
    """A family of shapes of a board whose corners stand at ``flat`` (n, 2), squares from its middle.

    Each of its parameters η (S,) shifts corners along one ``axis`` (S,) of the board, 0, 1 or 2, by its own of the
    ``functions`` (n, S), and belongs to one ``part`` (S,); ``prior_std`` (S,) in squares, about the mean of zero.
    """

    flat: Floats
    functions: Floats
    axis: Ints
    part: NDArray[np.str_]
    prior_std: Floats

    def of(self, *parts: str) -> BoardShape:
        """The family within this one that has these ``parts`` alone."""
        keep = np.isin(self.part, parts)
        return replace(
            self,
            functions=self.functions[:, keep],
            axis=self.axis[keep],
            part=self.part[keep],
            prior_std=self.prior_std[keep],
        )

    def has(self, part: str) -> bool:
        """Whether ``part`` is free."""
        return part in self.part

    def smaller(self) -> list[BoardShape]:
        """All families within this one that lack a bend or a stretch, itself first. A board that is warped has both:
        how much of each is hard to tell from the lens, and to hold it at none would be to know it.
        """
        if self.has(WARP):
            return [self]
        choices = product(*(((part,), ()) if self.has(part) else ((),) for part in OPTIONAL))
        return [self.of(*chain(*choice)) for choice in choices]

    @property
    def options(self) -> int:
        """How many parts it has that it could lack."""
        return sum(self.has(part) for part in OPTIONAL)

    def kept(self, smaller: BoardShape) -> Bools:
        """Which of this family's η (S,) the ``smaller`` family has too."""
        return np.isin(self.part, smaller.part)

    def carried(self, eta: Floats, of: BoardShape) -> Floats:
        """The parameters of what ``eta`` is ``of`` another family of the board, as far as this one has its parts."""
        found = np.zeros(len(self.part))
        found[np.isin(self.part, of.part)] = eta[np.isin(of.part, self.part)]
        return found

    def warped(self, plane_std: float, height_std: float) -> BoardShape:
        """The same with a warp whose shifts have these standard deviations, squares, along x and y, and along z."""
        bare, functions = self.of(*OPTIONAL), surface_functions(self.flat)
        count = functions.shape[1]
        return BoardShape(
            self.flat,
            np.concatenate([bare.functions, np.tile(functions, 3)], axis=1),
            np.append(bare.axis, np.repeat([0, 1, 2], count)),
            np.append(bare.part, np.repeat(WARP, 3 * count)),
            np.append(bare.prior_std, np.repeat([plane_std, plane_std, height_std], count)),
        )

    def points(self, eta: Floats) -> Floats:
        """All corners (n, 3) of the board, squares from its middle; heights away from the camera are positive."""
        return self._shifted(self.flat, self.functions, eta)

    def seen_points(self, eta: Floats, seen: Observations) -> Floats:
        """The points (N, 3) that ``seen`` shows."""
        return self._shifted(seen.lattice, self._rows(seen), eta)

    def slopes(self, by_point: Floats, seen: Observations) -> Floats:
        """The derivatives (N, m, S) by η of what has the derivatives ``by_point`` (N, m, 3) by the points ``seen``."""
        return np.asarray(by_point[:, :, self.axis] * self._rows(seen)[:, None, :])

    def stretch(self, eta: Floats) -> float:
        """ε: how much longer y's squares are than x's, as a fraction."""
        return float(eta[(self.part == STRETCH) & (self.axis == 1)].sum())

    def shear(self, eta: Floats) -> float:
        """γ: how far x's lines lean along x for each square along y, a fraction."""
        return float(eta[(self.part == STRETCH) & (self.axis == 0)].sum())

    def warp(self, eta: Floats) -> Floats:
        """What the warp alone shifts the corners by, (n, 3) squares."""
        return self._shifted(np.zeros_like(self.flat), self.functions * (self.part == WARP), eta)

    def _rows(self, seen: Observations) -> Floats:
        """The functions (N, S) at the corners ``seen``, without a warp where a view may have misplaced them."""
        rows = self.functions[seen.corner]
        if self.has(WARP) and not seen.placed.all():
            rows[np.ix_(~seen.placed, self.part == WARP)] = 0.0
        return rows

    def _shifted(self, flat: Floats, functions: Floats, eta: Floats) -> Floats:
        shifts = [functions[:, self.axis == axis] @ eta[self.axis == axis] for axis in range(3)]
        return np.asarray(np.column_stack([flat, np.zeros(len(flat))]) + np.stack(shifts, axis=1))


def board_shape(board: Board) -> BoardShape:
    """All shapes that ``board`` may have but for a warp; a screen's pixels are a true square lattice, if a bent one."""
    flat = lattice(board) - lattice_middle(board)
    xi, upsilon = flat.T / np.abs(flat).max(axis=0)[:, None]
    bends = np.column_stack([xi**2, xi * upsilon, upsilon**2, xi**4, xi**2 * upsilon**2, upsilon**4])
    count = bends.shape[1]
    printed = BoardShape(
        flat,
        np.column_stack([bends, flat[:, 1], flat[:, 1]]),
        np.append(np.repeat(2, count), [1, 0]),
        np.append(np.repeat(BEND, count), [STRETCH, STRETCH]),
        np.append(np.repeat(HEIGHT_STD, count), [STRETCH_STD, STRETCH_STD]),
    )
    return printed.of(BEND) if isinstance(board, Screen) else printed
