"""A polynomial from the image to ray angles, one for each angle: c = Σ b_jk u^j v^k.

The constant and the antisymmetric linear part are left out: they are rotations of the camera, which the boards' poses
represent already.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.geometry import inverse_2x2
from pinholify.refinement.trends.base import Angles, RayChart, Search, Trend

DEGREES = (3, 5, 7)
LINEAR_STD = 10.0
HIGHER_STD = 1.0
NEWTON_STEPS = 20
LONGEST_STEP = 0.2  # of Newton's method, in normalised image units


@dataclass(frozen=True, slots=True)
class PolynomialTrend:
    """The polynomial of total degree up to ``order``.

    β (p,) holds the symmetric linear part (3), then the terms of higher degree of the first angle, then of the second.
    """

    order: int

    @property
    def name(self) -> str:
        """The trend's name, such as ``polynomial:3``."""
        return f"polynomial:{self.order}"

    @property
    def family(self) -> str:
        """The name without the order."""
        return "polynomial"

    @property
    def chart(self) -> RayChart:
        """The chart of the rays: angles."""
        return Angles()

    @property
    def _exponents(self) -> tuple[Ints, Ints]:
        pairs = [(j, total - j) for total in range(1, self.order + 1) for j in range(total, -1, -1)]
        j, k = np.array(pairs).T
        return j, k

    def around(self) -> Search:
        """A search of this trend alone."""
        return Search(self, (self,))

    def of_order(self, order: int) -> PolynomialTrend:
        """The polynomial of degree ``order``."""
        return PolynomialTrend(order)

    def kept(self, smaller: Trend) -> Bools:
        """Mask (p,) of the linear part and the terms up to the degree of ``smaller``."""
        bends = np.sum(self._exponents, axis=0)[2:] <= smaller.order
        return np.concatenate([np.ones(3, dtype=bool), bends, bends])

    @property
    def level(self) -> bool:
        """True, because neither a constant nor an antisymmetric linear part is free."""
        return True

    @property
    def inverse_is_iterative(self) -> bool:
        """True: :meth:`image` is by Newton's method."""
        return True

    @property
    def prior_std(self) -> Floats:
        """Standard deviations (p,) of β: wide for the linear part, 1 for the terms of higher degree."""
        return np.array([LINEAR_STD] * 3 + [HIGHER_STD] * (2 * (len(self._exponents[0]) - 2)))

    def start(self, w: Floats, c: Floats) -> Floats:
        """The β (p,) of linear least squares in the angles ``c`` (n, 2) at ``w`` (n, 2)."""
        first, second = self._columns(w)
        return np.asarray(np.linalg.lstsq(np.concatenate([first, second]), c.T.ravel(), rcond=1e-9)[0])

    def resembling(self, other: Trend, beta: Floats) -> None:
        """None: the linear :meth:`start` finds all coefficients."""

    def _coefficients(self, beta: Floats) -> Floats:
        """Coefficients b (terms, 2) of both angles."""
        bends = beta[3:].reshape(2, -1)
        return np.column_stack([np.append(beta[[0, 1]], bends[0]), np.append(beta[[1, 2]], bends[1])])

    def ray(self, beta: Floats, w: Floats) -> Floats:
        """Angles c (n, 2) of image points ``w`` (n, 2)."""
        return np.asarray(self._monomials(w, 0, 0) @ self._coefficients(beta))

    def _slope(self, beta: Floats, w: Floats) -> Floats:
        coefficients = self._coefficients(beta)
        return np.stack([self._monomials(w, 1, 0) @ coefficients, self._monomials(w, 0, 1) @ coefficients], axis=2)

    def image(self, beta: Floats, c: Floats, near: Floats) -> Floats:
        """Image points w (n, 2) of angles ``c`` (n, 2), by Newton's method from ``near``; nan where it diverges."""
        w = np.array(near)
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                error = c - self.ray(beta, w)
                if not np.nanmax(np.abs(error), initial=0.0) > 1e-12:
                    break
                step = (inverse_2x2(self._slope(beta, w)) @ error[:, :, None])[:, :, 0]
                length = np.linalg.norm(step, axis=1, keepdims=True)
                w = w + step * np.minimum(1.0, LONGEST_STEP / np.maximum(length, 1e-300))
            return np.where(np.abs(c - self.ray(beta, w)).max(axis=1, keepdims=True) < 1e-9, w, np.nan)

    def jacobians(self, beta: Floats, w: Floats, c: Floats) -> tuple[Floats, Floats]:
        """∂w/∂c (n, 2, 2), and ∂w/∂β at fixed c (n, 2, p), at image points ``w`` (n, 2)."""
        by_ray = inverse_2x2(self._slope(beta, w))
        return by_ray, -by_ray @ np.stack(self._columns(w), axis=1)

    def folds(self, beta: Floats, points: Floats) -> bool:
        """Whether the determinant of ∂c/∂w is not positive at any of ``points`` (n, 2)."""
        return bool((np.linalg.det(self._slope(beta, points)) <= 0).any())

    def _columns(self, w: Floats) -> tuple[Floats, Floats]:
        """∂c/∂β of the first and of the second angle, (n, p) each."""
        basis = self._monomials(w, 0, 0)
        none, bends = np.zeros((len(w), 1)), basis[:, 2:]
        zero = np.zeros_like(bends)
        first = np.concatenate([basis[:, :2], none, bends, zero], axis=1)
        return first, np.concatenate([none, basis[:, :2], zero, bends], axis=1)

    def _monomials(self, w: Floats, du: int, dv: int) -> Floats:
        """All monomials at ``w`` (n, 2), differentiated ``du`` and ``dv`` times (0 or 1) in u and v: (n, terms)."""
        j, k = self._exponents
        u, v = (np.vander(axis, self.order + 1, increasing=True) for axis in w.T)
        factor = (j if du else 1) * (k if dv else 1)
        return np.asarray(factor * u[:, np.maximum(j - du, 0)] * v[:, np.maximum(k - dv, 0)])


def polynomial_searches(order: int | None) -> list[Search]:
    """One search for all :data:`DEGREES`, or for the degree ``order``."""
    degrees = DEGREES if order is None else (order,)
    return [Search(PolynomialTrend(max(degrees)), tuple(PolynomialTrend(n) for n in degrees))]
