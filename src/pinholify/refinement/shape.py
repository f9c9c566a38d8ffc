"""Boards that are not flat, square lattices: a smooth shape shared by all views, linear in its parameters η.

A shape has up to three parts. *Bend*: a height z = Σ η_j m_j(ξ, υ) with even monomials of ξ, υ ∈ [−1, 1], so that a
half turn of the board, which an image may not show, changes nothing. *Stretch*: a print that is longer along y than
along x, and sheared, by the feed of the printer: Y → (1 + ε) Y, X → X + γ Y. *Warp*: smooth shifts of all corners along
x, y and z, of any form. Shifts and rotations of the whole board are its poses; the side of a square is the unit.
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

HEIGHT_STD = 0.1  # prior standard deviation of a bend's η, squares
STRETCH_STD = 0.003  # prior standard deviation of ε and of γ
BEND, STRETCH, WARP = "bend", "stretch", "warp"
OPTIONAL_PARTS = (BEND, STRETCH)  # that the evidence may leave out


@dataclass(frozen=True, slots=True, eq=False)
class BoardShape:
    """A family of shapes of a board whose corners are at ``flat`` (n, 2), in squares from its middle.

    Parameter η_s of η (S,) shifts the corners along ``axis[s]`` of the board, 0, 1 or 2, by η_s times
    ``functions[:, s]`` (n,), and belongs to ``part[s]``. Its prior has mean zero and the standard deviation
    ``prior_std[s]``.
    """

    flat: Floats
    functions: Floats
    axis: Ints
    part: NDArray[np.str_]
    prior_std: Floats

    def of(self, *parts: str) -> BoardShape:
        """The family within this one that has only these ``parts``."""
        keep = np.isin(self.part, parts)
        return replace(
            self,
            functions=self.functions[:, keep],
            axis=self.axis[keep],
            part=self.part[keep],
            prior_std=self.prior_std[keep],
        )

    def has(self, part: str) -> bool:
        """Whether the family has ``part``."""
        return part in self.part

    def smaller(self) -> list[BoardShape]:
        """All families within this one that lack a bend or a stretch or both, this one first.

        A board with a warp keeps both: the data hardly separate them from the lens, and fixing them at zero would
        claim to know them.
        """
        if self.has(WARP):
            return [self]
        choices = product(*(((part,), ()) if self.has(part) else ((),) for part in OPTIONAL_PARTS))
        return [self.of(*chain(*choice)) for choice in choices]

    @property
    def options(self) -> int:
        """The number of parts that it has and could lack."""
        return sum(self.has(part) for part in OPTIONAL_PARTS)

    def kept(self, smaller: BoardShape) -> Bools:
        """Mask (S,) of the η that the ``smaller`` family has too."""
        return np.isin(self.part, smaller.part)

    def carried(self, eta: Floats, of: BoardShape) -> Floats:
        """The parameters (S,) of the shape that has ``eta`` in the family ``of``; parts missing there are zero."""
        found = np.zeros(len(self.part))
        found[np.isin(self.part, of.part)] = eta[np.isin(of.part, self.part)]
        return found

    def warped(self, plane_std: float, height_std: float) -> BoardShape:
        """This family with a warp of prior standard deviations ``plane_std`` along x and y, ``height_std`` along z.

        Both are in squares. A warp that the family has already is replaced.
        """
        bare, functions = self.of(*OPTIONAL_PARTS), surface_functions(self.flat)
        count = functions.shape[1]
        return BoardShape(
            self.flat,
            np.concatenate([bare.functions, np.tile(functions, 3)], axis=1),
            np.append(bare.axis, np.repeat([0, 1, 2], count)),
            np.append(bare.part, np.repeat(WARP, 3 * count)),
            np.append(bare.prior_std, np.repeat([plane_std, plane_std, height_std], count)),
        )

    def points(self, eta: Floats) -> Floats:
        """All corners (n, 3) of the board, in squares from its middle; z is positive away from the camera."""
        return self._shifted(self.flat, self.functions, eta)

    def seen_points(self, eta: Floats, seen: Observations) -> Floats:
        """The board's points (N, 3) at the corners of ``seen``, in squares from its middle."""
        return self._shifted(seen.lattice, self._rows(seen), eta)

    def slopes(self, by_point: Floats, seen: Observations) -> Floats:
        """Derivatives (N, m, S) by η, from those by the board's points, ``by_point`` (N, m, 3)."""
        return np.asarray(by_point[:, :, self.axis] * self._rows(seen)[:, None, :])

    def stretch(self, eta: Floats) -> float:
        """The stretch ε: how much longer a square is along y than along x, as a fraction."""
        return float(eta[(self.part == STRETCH) & (self.axis == 1)].sum())

    def shear(self, eta: Floats) -> float:
        """The shear γ: the shift along x per square along y."""
        return float(eta[(self.part == STRETCH) & (self.axis == 0)].sum())

    def warp(self, eta: Floats) -> Floats:
        """The shifts (n, 3) of all corners by the warp alone, in squares."""
        return self._shifted(np.zeros_like(self.flat), self.functions * (self.part == WARP), eta)

    def _rows(self, seen: Observations) -> Floats:
        """The functions (N, S) at the corners of ``seen``; those of a warp are zero where ids are relative."""
        rows = self.functions[seen.corner]
        if self.has(WARP) and not seen.placed.all():
            rows[np.ix_(~seen.placed, self.part == WARP)] = 0.0
        return rows

    def _shifted(self, flat: Floats, functions: Floats, eta: Floats) -> Floats:
        shifts = [functions[:, self.axis == axis] @ eta[self.axis == axis] for axis in range(3)]
        return np.asarray(np.column_stack([flat, np.zeros(len(flat))]) + np.stack(shifts, axis=1))


def board_shape(board: Board) -> BoardShape:
    """The family with all parts but a warp; a screen has no stretch, since its pixels are a true square lattice."""
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
