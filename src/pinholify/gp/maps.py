"""Maps of the plane learnt from point pairs: a trend and a Gaussian process, with honest uncertainty.

Two kinds. :class:`AdditiveMap` is the paper's: each output is a constant plus its own GP, with its own noise in the
output. :class:`DisplacementMap` puts the noise where it is, in the image: with a parametric trend q = h(w), a point q
is seen at uv = w + g(w) + noise, w = h⁻¹(q), and g is a GP that displaces what the trend predicts. Inputs w are exact,
the noise is one number in px for both axes, and g is as stationary as the lens is. (Regressing w on uv instead would
let the likelihood rise by shrinking w.) The trend's parameters are linearised into the GP's linear part, so its
likelihood and variance count what is not known of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Floats
from pinholify.geometry import solve_2x2
from pinholify.gp.regression import GaussianProcess
from pinholify.gp.trends import Trend
from pinholify.gp.trends.base import LONGEST_STEP, inverse

INVERSE_STEPS = 30
INVERSE_TOLERANCE = 1e-7  # px
INVERSE_ROUNDING = 1e-2  # px
NEWTON_STEPS = 20
NEWTON_TOLERANCE = 1e-8  # of the inputs' extent: of an error that the same step squares
NEWTON_ROUNDING = 1e-7  # an error below this that no longer shrinks is the rounding error of the kernel sum


Nearby = Callable[[Floats], tuple[Floats, float]]
"""q (n, 2) → px (n, 2) near those that are mapped there, and the longest step in px that helps from them on."""


class SmoothMap(Protocol):
    """A smooth map of the plane."""

    def value(self, uv: Floats) -> Floats:
        """q at ``uv`` (n, 2): (n, 2)."""
        ...

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv at ``uv`` (n, 2): (n, 2, 2)."""
        ...


class PlaneMap(SmoothMap, Protocol):
    """A smooth map of the plane, uv (px) → q, that knows its own uncertainty."""

    def covariance(self, uv: Floats) -> Floats:
        """Posterior covariance of q at ``uv`` (n, 2): (n, 2, 2)."""
        ...

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """The same, leaving out what a turn of the whole camera would undo: how well the map's shape is known."""
        ...

    def virtual_covariance(self, uv: Floats) -> Floats | None:
        """Covariance (n, 2, 2) of virtual points where they share errors with K; None where that of q says it all."""
        ...

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """The uv (n, 2) that are mapped to ``q`` (n, 2); nan where none is found.

        A map that searches asks ``nearby`` where to begin.
        """
        ...

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """How q at ``uv`` (n, 2) would move had the data been drawn anew with other noise: (draws, n, 2)."""
        ...


def newton_inverse(smooth_map: SmoothMap, q: Floats, start: Floats, reach: float) -> Floats:
    """uv (n, 2) that ``smooth_map`` takes to ``q`` (n, 2), by Newton's method from ``start``; nan without convergence.

    Steps are no longer than ``reach`` px, and a point that has gone 20 of them away is given up.
    """
    uv = np.array(start)
    active = np.arange(len(q))
    done = np.zeros(len(q), dtype=bool)
    before = np.full(len(q), np.inf)
    for _ in range(INVERSE_STEPS):
        error = q[active] - smooth_map.value(uv[active])
        step = solve_2x2(smooth_map.jacobian(uv[active]), error)
        length = np.linalg.norm(step, axis=1)
        step *= np.minimum(1.0, reach / np.maximum(length, 1e-300))[:, None]
        uv[active] += step
        # Short steps that no longer shrink are the rounding error of the kernel sum, which no step undoes.
        arrived = (length < INVERSE_TOLERANCE) | ((length < INVERSE_ROUNDING) & (length > before[active] / 2.0))
        done[active[arrived]] = True
        before[active] = length
        near = np.linalg.norm(uv[active] - start[active], axis=1) < 20.0 * reach
        active = active[~arrived & near]
        if not len(active):
            break
    return np.where(done[:, None], uv, np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Scaling:
    """An isotropic normalisation: normalised = (p − ``offset``) / ``scale``."""

    offset: Floats
    scale: float

    def normalise(self, p: Floats) -> Floats:
        """To normalised coordinates."""
        return (p - self.offset) / self.scale

    def restore(self, p: Floats) -> Floats:
        """Back from normalised coordinates."""
        return p * self.scale + self.offset


def scaling_of(p: Floats) -> Scaling:
    """The normalisation that brings ``p`` (n, 2) into the unit circle around their mid-range."""
    offset = (p.min(axis=0) + p.max(axis=0)) / 2.0
    return Scaling(offset, float(np.linalg.norm(p - offset, axis=1).max()))


@dataclass(frozen=True, slots=True, eq=False)
class AdditiveMap:
    """q = mean + g(uv), a GP for each output, the paper's two independent GPs."""

    inputs: Scaling
    outputs: Scaling
    mean: Floats
    processes: tuple[GaussianProcess, GaussianProcess]

    def value(self, uv: Floats) -> Floats:
        """q (n, 2)."""
        x = self.inputs.normalise(uv)
        return self.outputs.restore(self.mean + np.concatenate([gp.mean(x) for gp in self.processes], axis=1))

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv (n, 2, 2)."""
        x = self.inputs.normalise(uv)
        rows = [gp.jacobian(x) for gp in self.processes]
        return np.concatenate(rows, axis=1) * (self.outputs.scale / self.inputs.scale)

    def covariance(self, uv: Floats) -> Floats:
        """Covariance of q (n, 2, 2): diagonal, the outputs are independent."""
        x = self.inputs.normalise(uv)
        variances = np.stack([gp.variance(x) for gp in self.processes], axis=1)
        return variances[:, :, None] * np.eye(2) * self.outputs.scale**2

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """The covariance itself: the plane is the reference board's, there is no turn."""
        return self.covariance(uv)

    def virtual_covariance(self, uv: Floats) -> None:
        """None: the map ends in the virtual plane, so K has no part in it."""
        return

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """uv (n, 2) of ``q``, by Newton's method."""
        return newton_inverse(self, q, *nearby(q))

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Shifts of q (draws, n, 2), to first order."""
        x = self.inputs.normalise(uv)
        moves = [gp.noise_response(x, np.empty((1, len(x), 0)), draws, rng) for gp in self.processes]
        return np.concatenate(moves, axis=2) * self.outputs.scale


@dataclass(frozen=True, slots=True, eq=False)
class DisplacementMap:
    """q = h(w) with w + g(w) = uv: trend ``h`` with parameters ``beta``, ``process`` the GP g with two outputs."""

    inputs: Scaling
    outputs: Scaling
    trend: Trend
    beta: Floats
    process: GaussianProcess

    def value(self, uv: Floats) -> Floats:
        """q (n, 2)."""
        w = self._undisplaced(self.inputs.normalise(uv))
        return self.outputs.restore(self.trend.value(self.beta, w))

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv (n, 2, 2)."""
        return self._jacobian_at(self._undisplaced(self.inputs.normalise(uv)))

    def covariance(self, uv: Floats) -> Floats:
        """Covariance of q (n, 2, 2), the trend's parameters included."""
        w = self._undisplaced(self.inputs.normalise(uv))
        jacobian = self._jacobian_at(w)
        covariance = self.process.covariance(w, trend_features(self.trend, self.beta, w)) * self.inputs.scale**2
        return np.asarray(jacobian @ covariance @ jacobian.transpose(0, 2, 1))

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """The covariance itself: the plane is the reference board's, there is no turn."""
        return self.covariance(uv)

    def virtual_covariance(self, uv: Floats) -> None:
        """None: the map ends in the virtual plane, so K has no part in it."""
        return

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """uv (n, 2) of ``q``: only the trend needs inverting."""
        start = self.inputs.normalise(nearby(q)[0])
        w, reached = inverse(self.trend, self.beta, self.outputs.normalise(q), start)
        uv = self.inputs.restore(self._displaced(w))
        return np.where(reached[:, None], uv, np.nan)

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Shifts of q (draws, n, 2), to first order; a point seen farther right is mapped farther left."""
        w = self._undisplaced(self.inputs.normalise(uv))
        features = trend_features(self.trend, self.beta, w)
        moves = self.process.noise_response(w, features, draws, rng) * self.inputs.scale
        return np.asarray(np.einsum("nij,dnj->dni", -self._jacobian_at(w), moves))

    def _jacobian_at(self, w: Floats) -> Floats:
        inner = np.linalg.inv(np.eye(2) + self.process.jacobian(w))
        outer = self.trend.input_jacobian(self.beta, w)
        return np.asarray(outer @ inner) * (self.outputs.scale / self.inputs.scale)

    def _displaced(self, w: Floats) -> Floats:
        return np.asarray(w + self.process.mean(w))

    def _undisplaced(self, x: Floats) -> Floats:
        """The w with w + g(w) = ``x`` (n, 2), by Newton's method from the nearest training point."""
        w = np.full_like(x, np.nan)
        active = np.flatnonzero(np.isfinite(x).all(axis=1))
        known = self.process.inputs
        displaced = self._displaced(known)
        nearest = cKDTree(displaced).query(x[active])[1]
        w[active] = x[active] - displaced[nearest] + known[nearest]
        before = np.full(len(x), np.inf)
        for _ in range(NEWTON_STEPS):
            g, slope = self.process.mean_and_jacobian(w[active])
            error = w[active] + g - x[active]
            step = solve_2x2(np.eye(2) + slope, error)
            length = np.linalg.norm(step, axis=1, keepdims=True)
            w[active] -= np.nan_to_num(step * np.minimum(1.0, LONGEST_STEP / np.maximum(length, 1e-300)))
            largest = np.maximum(*np.abs(error.T))
            going = (largest > NEWTON_TOLERANCE) & ((largest > NEWTON_ROUNDING) | (largest < before[active] / 2.0))
            before[active] = largest
            active = active[going]
            if not len(active):
                break
        return w


def trend_features(trend: Trend, beta: Floats, w: Floats) -> Floats:
    """How the trend's parameters move w = h⁻¹(q) at fixed q: −(∂h/∂w)⁻¹ ∂h/∂β at ``w`` (n, 2), as (2, n, p)."""
    features = -np.linalg.solve(trend.input_jacobian(beta, w), trend.parameter_jacobian(beta, w))
    return np.ascontiguousarray(features.transpose(1, 0, 2))
