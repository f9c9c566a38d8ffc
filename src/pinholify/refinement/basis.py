"""A Gaussian process on a box as a weighted sum of sines (Solin & Särkkä 2020, Hilbert-space reduced-rank
GPs).

On the box |w_d| ≤ L_d the functions φ_jk(w) = sin(ω_j (u + L_u)) sin(ω_k (v + L_v)) / √(L_u L_v), ω_j = πj/(2
L), carry a stationary process when the weights are independent with variance S(ω_j, ω_k), the kernel's
spectral density.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints, frozen
from pinholify.refinement.trends.base import inverse_2x2

MARGIN = 0.35  # of the box around the image, in half diagonals: at the box's edge the process is held at zero
NEWTON_STEPS, NEWTON_TOLERANCE = 20, 1e-8  # of an error that the same step squares
REACH = 4.8  # frequencies kept, in inverse length scales: beyond it the SE density is below 1e-5 of its maximum


@dataclass(frozen=True, slots=True, eq=False)
class SineBasis:
    """M functions: ``order`` (M, 2) holds j and k (from 1), ``half_box`` (2,) L."""

    half_box: Floats
    order: Ints

    def __post_init__(self) -> None:
        object.__setattr__(self, "half_box", frozen(self.half_box, (2,)))
        object.__setattr__(self, "order", frozen(self.order, (None, 2), np.int64))

    def __len__(self) -> int:
        """M."""
        return len(self.order)

    @property
    def frequencies(self) -> Floats:
        """Angular frequencies (M, 2)."""
        return np.asarray(np.pi * self.order / (2.0 * self.half_box))

    def values(self, w: Floats) -> Floats:
        """φ at ``w`` (n, 2): (n, M), a function after the other in memory."""
        (u, v), _ = self._factors(w)
        values = np.empty((len(self), len(w)))
        for row, (j, k) in zip(values, self.order - 1, strict=True):
            np.multiply(u[:, j], v[:, k], out=row)
        return values.T

    def combined(self, weights: Floats, w: Floats) -> Floats:
        """g alone (n, m), in half the time of :meth:`combine`."""
        (u, v), _ = self._factors(w)
        return np.stack([((u @ grid) * v).sum(axis=1) for grid in self._grids(weights)], axis=1)

    def combine(self, weights: Floats, w: Floats) -> tuple[Floats, Floats]:
        """g = Σ φ · ``weights`` (M, m) at ``w`` (n, 2), and ∂g/∂w: (n, m) and (n, m, 2)."""
        (u, v), (du, dv) = self._factors(w)
        value, slope = np.empty((len(w), weights.shape[1])), np.empty((len(w), weights.shape[1], 2))
        for i, grid in enumerate(self._grids(weights)):
            along = u @ grid
            value[:, i] = (along * v).sum(axis=1)
            slope[:, i, 0], slope[:, i, 1] = ((du @ grid) * v).sum(axis=1), (along * dv).sum(axis=1)
        return value, slope

    def undisplaced(self, weights: Floats, x: Floats) -> Floats:
        """The w (n, 2) with w + g(w) = ``x`` (n, 2), by Newton's method; g is small and smooth."""
        w = np.array(x)
        if not len(self):
            return w
        for _ in range(NEWTON_STEPS):
            g, slope = self.combine(weights, w)
            error = x - g - w
            w += (inverse_2x2(np.eye(2) + slope) @ error[:, :, None])[:, :, 0]
            if np.abs(error).max(initial=0.0) < NEWTON_TOLERANCE:
                break
        return w

    def _grids(self, weights: Floats) -> Floats:
        """``weights`` (M, m) laid out by j and k: (m, J, K)."""
        grids = np.zeros((weights.shape[1], *self.order.max(axis=0, initial=0)))
        grids[:, self.order[:, 0] - 1, self.order[:, 1] - 1] = weights.T
        return grids

    def _factors(self, w: Floats) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
        """The sines of both axes, (n, J) and (n, K), and their derivatives."""
        values, slopes = [], []
        for axis in (0, 1):
            count = int(self.order[:, axis].max(initial=0))
            length = self.half_box[axis]
            omega = np.pi * np.arange(1, count + 1) / (2.0 * length)
            angle = np.pi * (w[:, axis] + length) / (2.0 * length)
            cosines, sines = _multiples(np.cos(angle), np.sin(angle), count)
            values.append(sines.T / np.sqrt(length))
            slopes.append((cosines * (omega / np.sqrt(length))[:, None]).T)
        return (values[0], values[1]), (slopes[0], slopes[1])


def _multiples(cosine: Floats, sine: Floats, count: int) -> tuple[Floats, Floats]:
    """Cosines and sines (count, n) of 1 … ``count`` times an angle, by products, which are cheaper than sines."""
    waves = np.empty((count, len(cosine)), dtype=complex)
    step = cosine + 1j * sine
    power = np.ones_like(step)
    for row in waves:
        power = np.multiply(power, step, out=row)
    return waves.real, waves.imag


def sine_basis(half_size: Floats, length_scale: float) -> SineBasis:
    """The functions that a process of ``length_scale`` or longer needs on an image of ``half_size`` (2,)."""
    half_box = half_size + MARGIN
    j, k = (np.arange(1, int(np.ceil(2.0 * box * REACH / (np.pi * length_scale))) + 1) for box in half_box)
    order = np.stack(np.meshgrid(j, k, indexing="ij"), axis=-1).reshape(-1, 2)
    radius = np.linalg.norm(np.pi * order / (2.0 * half_box), axis=1)
    return SineBasis(half_box, order[radius <= REACH / length_scale])


def no_basis(half_size: Floats) -> SineBasis:
    """No functions at all: the process is switched off."""
    return SineBasis(half_size + MARGIN, np.empty((0, 2), np.int64))
