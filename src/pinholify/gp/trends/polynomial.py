"""A polynomial in both coordinates, each output its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints

LINEAR_STD = 10.0
HIGHER_STD = 1.0


@dataclass(frozen=True, slots=True)
class Polynomial:
    """h(x) = Σ b_jk u^j v^k, j + k ≤ ``order``; β holds the first output's coefficients, then the second's."""

    order: int

    @property
    def name(self) -> str:
        """``polynomial:order``."""
        return f"polynomial:{self.order}"

    @property
    def _exponents(self) -> tuple[Ints, Ints]:
        pairs = [(j, total - j) for total in range(self.order + 1) for j in range(total + 1)]
        j, k = np.array(pairs).T
        return j, k

    @property
    def prior_mean(self) -> Floats:
        """Zero."""
        return np.zeros(2 * len(self._exponents[0]))

    @property
    def prior_std(self) -> Floats:
        """Wide for the affine part, 1 for what bends."""
        j, k = self._exponents
        return np.tile(np.where(j + k <= 1, LINEAR_STD, HIGHER_STD), 2)

    def start(self, x: Floats, y: Floats) -> Floats:
        """The least-squares polynomial, held by the prior."""
        held = 1e-6 * np.diag(1.0 / self.prior_std[: len(self._exponents[0])])
        basis = np.concatenate([self._monomials(x, 0, 0), held])
        target = np.concatenate([y, np.zeros((basis.shape[1], 2))])
        return np.asarray(np.linalg.lstsq(basis, target, rcond=None)[0].T.ravel())

    def value(self, beta: Floats, x: Floats) -> Floats:
        """h(x; β)."""
        return np.asarray(self._monomials(x, 0, 0) @ beta.reshape(2, -1).T)

    def input_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂x."""
        coefficients = beta.reshape(2, -1).T
        return np.stack([self._monomials(x, 1, 0) @ coefficients, self._monomials(x, 0, 1) @ coefficients], axis=2)

    def parameter_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂β."""
        basis = self._monomials(x, 0, 0)
        zero = np.zeros_like(basis)
        return np.stack([np.concatenate([basis, zero], axis=1), np.concatenate([zero, basis], axis=1)], axis=1)

    def _monomials(self, x: Floats, du: int, dv: int) -> Floats:
        """All monomials at ``x`` (n, 2), differentiated ``du`` and ``dv`` times (0 or 1) in u and v: (n, terms)."""
        j, k = self._exponents
        factor = (j if du else 1) * (k if dv else 1)
        u, v = x[:, :1], x[:, 1:]
        return np.asarray(factor * u ** np.maximum(j - du, 0) * v ** np.maximum(k - dv, 0))
