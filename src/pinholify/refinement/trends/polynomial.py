"""A polynomial from the image to ray angles, each angle its own: c = Σ b_jk u^j v^k.

The constant and the antisymmetric linear part are left out: they are rotations of the camera, which the
boards' poses hold already.
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


@dataclass(frozen=True, slots=True)
class PolynomialTrend:
    """Total degree up to ``order``; β = (symmetric linear part: 3, first angle's bends, second angle's
    bends).
    """

    order: int

    @property
    def name(self) -> str:
        """``polynomial:order``."""
        return f"polynomial:{self.order}"

    @property
    def family(self) -> str:
        """The name without the order."""
        return "polynomial"

    @property
    def chart(self) -> RayChart:
        """Angles."""
        return Angles()

    @property
    def _exponents(self) -> tuple[Ints, Ints]:
        pairs = [(j, total - j) for total in range(1, self.order + 1) for j in range(total, -1, -1)]
        j, k = np.array(pairs).T
        return j, k

    def around(self) -> Search:
        """Itself alone."""
        return Search(self, (self,))

    def of_order(self, order: int) -> PolynomialTrend:
        """A polynomial of another degree."""
        return PolynomialTrend(order)

    def kept(self, smaller: Trend) -> Bools:
        """The linear part, and bends up to the ``smaller`` degree."""
        bends = np.sum(self._exponents, axis=0)[2:] <= smaller.order
        return np.concatenate([np.ones(3, dtype=bool), bends, bends])

    @property
    def level(self) -> bool:
        """Yes: that fixes the rotation."""
        return True

    @property
    def searches(self) -> bool:
        """Yes, by Newton's method."""
        return True

    @property
    def prior_std(self) -> Floats:
        """Wide for the linear part, 1 for what bends."""
        return np.array([LINEAR_STD] * 3 + [HIGHER_STD] * (2 * (len(self._exponents[0]) - 2)))

    def start(self, w: Floats, c: Floats) -> Floats:
        """Linear least squares in the angles."""
        first, second = self._columns(w)
        return np.asarray(np.linalg.lstsq(np.concatenate([first, second]), c.T.ravel(), rcond=1e-9)[0])

    def resembling(self, other: Trend, beta: Floats) -> None:
        """None: the linear start finds all coefficients."""

    def _coefficients(self, beta: Floats) -> Floats:
        """(terms, 2)."""
        bends = beta[3:].reshape(2, -1)
        return np.column_stack([np.append(beta[[0, 1]], bends[0]), np.append(beta[[1, 2]], bends[1])])

    def ray(self, beta: Floats, w: Floats) -> Floats:
        """c."""
        return np.asarray(self._monomials(w, 0, 0) @ self._coefficients(beta))

    def _slope(self, beta: Floats, w: Floats) -> Floats:
        coefficients = self._coefficients(beta)
        return np.stack([self._monomials(w, 1, 0) @ coefficients, self._monomials(w, 0, 1) @ coefficients], axis=2)

    def image(self, beta: Floats, c: Floats, near: Floats) -> Floats:
        """w, by Newton's method from ``near``."""
        w = np.array(near)
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                error = c - self.ray(beta, w)
                if not np.nanmax(np.abs(error), initial=0.0) > 1e-12:
                    break
                step = (inverse_2x2(self._slope(beta, w)) @ error[:, :, None])[:, :, 0]
                length = np.linalg.norm(step, axis=1, keepdims=True)
                w = w + step * np.minimum(1.0, 0.2 / np.maximum(length, 1e-300))
            return np.where(np.abs(c - self.ray(beta, w)).max(axis=1, keepdims=True) < 1e-9, w, np.nan)

    def jacobians(self, beta: Floats, w: Floats, c: Floats) -> tuple[Floats, Floats]:
        """∂w/∂c and ∂w/∂β."""
        by_ray = inverse_2x2(self._slope(beta, w))
        return by_ray, -by_ray @ np.stack(self._columns(w), axis=1)

    def folds(self, beta: Floats, points: Floats) -> bool:
        """Whether the determinant of ∂c/∂w is negative at any of ``points``."""
        return bool((np.linalg.det(self._slope(beta, points)) <= 0).any())

    def _columns(self, w: Floats) -> tuple[Floats, Floats]:
        """∂c/∂β of the first and the second angle, (n, p) each."""
        basis = self._monomials(w, 0, 0)
        none, bends = np.zeros((len(w), 1)), basis[:, 2:]
        zero = np.zeros_like(bends)
        first = np.concatenate([basis[:, :2], none, bends, zero], axis=1)
        return first, np.concatenate([none, basis[:, :2], zero, bends], axis=1)

    def _monomials(self, w: Floats, du: int, dv: int) -> Floats:
        """All monomials at ``w`` (n, 2), differentiated ``du`` and ``dv`` times (0 or 1) in u and v: (n,
        terms).
        """
        j, k = self._exponents
        u, v = (np.vander(axis, self.order + 1, increasing=True) for axis in w.T)
        factor = (j if du else 1) * (k if dv else 1)
        return np.asarray(factor * u[:, np.maximum(j - du, 0)] * v[:, np.maximum(k - dv, 0)])


def polynomial_searches(order: int | None) -> list[Search]:
    """One solve for all degrees, or for the given one."""
    degrees = DEGREES if order is None else (order,)
    return [Search(PolynomialTrend(max(degrees)), tuple(PolynomialTrend(n) for n in degrees))]
