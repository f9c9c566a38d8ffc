"""A Gaussian process on a box as a weighted sum of sines (Solin & Särkkä 2020, Hilbert-space reduced-rank GPs).

On the box |w_d| ≤ L_d the sum of the functions φ_jk(w) = sin(ω_j (u + L_u)) sin(ω_k (v + L_v)) / √(L_u L_v),
ω_j = πj/(2 L), is a stationary process if the weights are independent with variance S(ω_j, ω_k), the kernel's spectral
density. Exact inference then costs what a linear model of M functions costs, however many corners there are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pinholify.arrays import Floats, Ints, frozen
from pinholify.geometry import solve_2x2

BOX_MARGIN = 0.35  # of the box around the image, in half diagonals: at the edge of the box the process is zero
NEWTON_STEPS, NEWTON_TOLERANCE = 20, 1e-6  # the error before the last step, which squares it
MAX_FREQUENCY = 4.8  # that is kept, in inverse length scales: beyond it the SE density is below 1e-5 of its maximum


@dataclass(frozen=True, slots=True, eq=False)
class SineBasis:
    """The M functions φ_jk with the ``order`` (M, 2) j, k (from 1) on the box of half size ``half_box`` (2,) L."""

    half_box: Floats
    order: Ints

    def __post_init__(self) -> None:
        object.__setattr__(self, "half_box", frozen(self.half_box, (2,)))
        object.__setattr__(self, "order", frozen(self.order, (None, 2), np.int64))

    def __len__(self) -> int:
        """The number of functions M."""
        return len(self.order)

    @property
    def frequencies(self) -> Floats:
        """Angular frequencies ω (M, 2), in radians per normalised unit."""
        return np.asarray(np.pi * self.order / (2.0 * self.half_box))

    def values(self, w: Floats) -> Floats:
        """The functions φ at ``w`` (n, 2): (n, M), in memory one function after the other."""
        (_, u), (_, v) = self._waves(w)
        u /= np.sqrt(self.half_box.prod())
        values = np.empty((len(self), len(w)))
        for row, (j, k) in zip(values, self.order - 1, strict=True):
            np.multiply(u[j], v[k], out=row)
        return values.T

    def combined(self, weights: Floats, w: Floats) -> Floats:
        """The sums g = Σ φ · ``weights`` (M, m) at ``w`` (n, 2), (n, m), in half the time of :meth:`combine`."""
        (_, u), (_, v) = self._waves(w)
        return _paired(self._grids(weights) @ u, v)

    def combine(self, weights: Floats, w: Floats) -> tuple[Floats, Floats]:
        """The sums g = Σ φ · ``weights`` (M, m) at ``w`` (n, 2), (n, m), and ∂g/∂w (n, m, 2)."""
        (du, u), (dv, v) = self._waves(w)
        du *= self._frequencies(0)
        dv *= self._frequencies(1)
        grids = self._grids(weights)
        along = grids @ u
        return _paired(along, v), np.stack([_paired(grids @ du, v), _paired(along, dv)], axis=2)

    def product_series(self, matrices: Floats) -> Floats:
        """Coefficients (m, 2K + 1, 2J + 1) of cosines of each axis, whose sum is φᵀCφ, for C in ``matrices`` (m, M, M).

        J and K are the highest orders. A product of two sines is half the difference of two cosines, so there are far
        fewer cosines than products.
        """
        width, height = 2 * self.order.max(axis=0, initial=0) + 1
        series = np.zeros((len(matrices), height * width))
        for sign, place in _products(self):
            for row, matrix in zip(series, matrices, strict=True):
                row += sign * np.bincount(place.ravel(), matrix.ravel(), len(row))
        return series.reshape(len(matrices), height, width)

    def summed(self, series: Floats, w: Floats) -> Floats:
        """The sums of ``series`` (m, 2K + 1, 2J + 1) of :meth:`product_series` at ``w`` (n, 2): (n, m)."""
        along, across = self._cosines(w)
        return _paired(series @ along, across)

    def gram(self, w: Floats, weight: Floats) -> Floats:
        """The sum (M, M) of ``weight`` (n,) φ φᵀ over points ``w`` (n, 2), by far fewer products of cosines."""
        if not len(self):
            return np.zeros((0, 0))
        along, across = self._cosines(w)
        moments = (across * weight) @ along.T
        gram = np.zeros((len(self), len(self)))
        for sign, place in _products(self):
            gram += (sign * moments).ravel()[place]
        return gram

    def _cosines(self, w: Floats) -> list[Floats]:
        """Cosines of 0 … 2J and 0 … 2K times each axis' angle: (2J + 1, n) and (2K + 1, n)."""
        found = []
        for axis in (0, 1):
            cosines = np.ones((2 * int(self.order[:, axis].max(initial=0)) + 1, len(w)))
            cosines[1:] = _multiples(np.pi * (w[:, axis] / self.half_box[axis] + 1.0) / 2.0, len(cosines) - 1)[0]
            found.append(cosines)
        return found

    def undisplaced(self, weights: Floats, x: Floats) -> Floats:
        """The w (n, 2) with w + g(w) = ``x`` (n, 2), by Newton's method; g is small and smooth."""
        w = np.array(x)
        active = np.arange(len(w) if len(self) else 0)
        for _ in range(NEWTON_STEPS):
            if not len(active):
                break
            g, slope = self.combine(weights, w[active])
            error = x[active] - g - w[active]
            w[active] += solve_2x2(np.eye(2) + slope, error)
            active = active[np.maximum(*np.abs(error.T)) >= NEWTON_TOLERANCE]
        return w

    def _frequencies(self, axis: int) -> Floats:
        """Angular frequencies of one axis, (J, 1) or (K, 1)."""
        j = np.arange(1, self.order[:, axis].max(initial=0) + 1)
        return np.asarray(np.pi * j[:, None] / (2.0 * self.half_box[axis]))

    def _grids(self, weights: Floats) -> Floats:
        """``weights`` (M, m) of functions without their common factor, laid out by k and j: (m, K, J)."""
        grids = np.zeros((weights.shape[1], *self.order.max(axis=0, initial=0)[::-1]))
        grids[:, self.order[:, 1] - 1, self.order[:, 0] - 1] = weights.T / np.sqrt(self.half_box.prod())
        return grids

    def _waves(self, w: Floats) -> list[tuple[Floats, Floats]]:
        """The cosines and the sines of each axis, (J, n) and (K, n)."""
        angles = np.pi * (w + self.half_box) / (2.0 * self.half_box)
        return [_multiples(a, count) for a, count in zip(angles.T, self.order.max(axis=0, initial=0), strict=True)]


@lru_cache(maxsize=4)
def _products(basis: SineBasis) -> list[tuple[float, Ints]]:
    """All φ_a φ_b as four products of cosines: the factor and the place (M, M) of each in a table (2K + 1, 2J + 1)."""
    order = basis.order
    differences, sums = np.abs(order[:, None] - order), order[:, None] + order
    width = 2 * int(order[:, 0].max(initial=0)) + 1
    factor = 0.25 / float(basis.half_box.prod())
    pairs = [(differences, differences), (differences, sums), (sums, differences), (sums, sums)]
    signs = (factor, -factor, -factor, factor)
    return [(sign, k[:, :, 1] * width + j[:, :, 0]) for sign, (j, k) in zip(signs, pairs, strict=True)]


def _paired(along: Floats, across: Floats) -> Floats:
    """The sums over k of ``along`` (m, K, n) · ``across`` (K, n): (n, m)."""
    return np.asarray(np.einsum("mkn,kn->mn", along, across).T)


def _multiples(angle: Floats, count: int) -> tuple[Floats, Floats]:
    """Cosines and sines (count, n) of 1 … ``count`` times an angle, by products, which are cheaper than sines."""
    cosines, sines = np.empty((2, count, len(angle)))
    cosine, sine = np.cos(angle), np.sin(angle)
    c, s = np.ones_like(angle), np.zeros_like(angle)
    for next_c, next_s in zip(cosines, sines, strict=True):
        c, s = np.subtract(c * cosine, s * sine, out=next_c), np.add(s * cosine, c * sine, out=next_s)
    return cosines, sines


def sine_basis(half_size: Floats, length_scale: float) -> SineBasis:
    """The functions for a process of ``length_scale`` or longer on an image of ``half_size`` (2,), both normalised."""
    return _sine_basis(tuple(half_size), length_scale)


@lru_cache(maxsize=4)
def _sine_basis(half_size: tuple[float, float], length_scale: float) -> SineBasis:
    half_box = np.array(half_size) + BOX_MARGIN
    j, k = (np.arange(1, int(np.ceil(2.0 * box * MAX_FREQUENCY / (np.pi * length_scale))) + 1) for box in half_box)
    order = np.stack(np.meshgrid(j, k, indexing="ij"), axis=-1).reshape(-1, 2)
    radius = np.linalg.norm(np.pi * order / (2.0 * half_box), axis=1)
    return SineBasis(half_box, order[radius <= MAX_FREQUENCY / length_scale])


def no_basis(half_size: Floats) -> SineBasis:
    """A basis without functions, which switches the process off."""
    return SineBasis(half_size + BOX_MARGIN, np.empty((0, 2), np.int64))
