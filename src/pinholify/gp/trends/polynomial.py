"""A polynomial in both coordinates, one for each output."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints

LINEAR_STD = 10.0
HIGHER_STD = 1.0


@dataclass(frozen=True, slots=True)
class Polynomial:
    """The trend h(x) = Σ b_jk u^j v^k, j + k ≤ ``order``; β (p,) holds b of the first output, then of the second."""

    order: int

    @property
    def name(self) -> str:
        """The registry's name, such as ``polynomial:3``."""
        return f"polynomial:{self.order}"

    @property
    def _exponents(self) -> tuple[Ints, Ints]:
        pairs = [(j, total - j) for total in range(self.order + 1) for j in range(total + 1)]
        j, k = np.array(pairs).T
        return j, k

    @property
    def prior_mean(self) -> Floats:
        """Mean (p,) of β under the prior: zero."""
        return np.zeros(2 * len(self._exponents[0]))

    @property
    def prior_std(self) -> Floats:
        """Standard deviations (p,) of β: wide for the affine part, 1 for the terms of higher degree."""
        j, k = self._exponents
        return np.tile(np.where(j + k <= 1, LINEAR_STD, HIGHER_STD), 2)

    def start(self, x: Floats, y: Floats) -> Floats:
        """The β (p,) of the least-squares polynomial from ``x`` to ``y``, both (n, 2)."""
        ridge = 1e-6 * np.diag(1.0 / self.prior_std[: len(self._exponents[0])])  # for too few points
        basis = np.concatenate([self._monomials(x, 0, 0), ridge])
        target = np.concatenate([y, np.zeros((basis.shape[1], 2))])
        return np.asarray(np.linalg.lstsq(basis, target, rcond=None)[0].T.ravel())

    def value(self, beta: Floats, x: Floats) -> Floats:
        """h(x; β) at ``x`` (n, 2): (n, 2)."""
        return np.asarray(self._monomials(x, 0, 0) @ beta.reshape(2, -1).T)

    def input_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂x at ``x`` (n, 2): (n, 2, 2)."""
        coefficients = beta.reshape(2, -1).T
        return np.stack([self._monomials(x, 1, 0) @ coefficients, self._monomials(x, 0, 1) @ coefficients], axis=2)

    def parameter_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂β at ``x`` (n, 2): (n, 2, p)."""
        basis = self._monomials(x, 0, 0)
        zero = np.zeros_like(basis)
        return np.stack([np.concatenate([basis, zero], axis=1), np.concatenate([zero, basis], axis=1)], axis=1)

    def _monomials(self, x: Floats, du: int, dv: int) -> Floats:
        """All monomials at ``x`` (n, 2), differentiated ``du`` and ``dv`` times (0 or 1) in u and v: (n, terms)."""
        j, k = self._exponents
        factor = (j if du else 1) * (k if dv else 1)
        u, v = x[:, :1], x[:, 1:]
        return np.asarray(factor * u ** np.maximum(j - du, 0) * v ** np.maximum(k - dv, 0))
