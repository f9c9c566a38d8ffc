"""Maps of the plane learnt from point pairs: a trend and a Gaussian process, with their uncertainty.

There are two kinds. :class:`AdditiveMap` is the paper's: each output is a constant plus its own GP, with its own noise
in the output. :class:`DisplacementMap` has the noise where it arises, in the image: with a parametric trend q = h(w), a
point q is seen at uv = w + g(w) + noise, w = h⁻¹(q), and the GP g displaces what the trend predicts. The inputs w are
exact, the noise is one number in px for both axes, and g is as stationary as the lens is. (Regressing w on uv instead
would let the likelihood rise by shrinking w.) The trend's parameters are linearised into the GP's linear part, so that
the likelihood and the variance account for their uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Floats
from pinholify.geometry import FARTHEST, inverse_2x2, solve_2x2
from pinholify.gp.regression import GaussianProcess
from pinholify.gp.trends import Trend
from pinholify.gp.trends.base import LONGEST_STEP, inverse

INVERSE_STEPS = 30
INVERSE_TOLERANCE_PX = 1e-7
INVERSE_ROUNDING_PX = 1e-2  # a step below this that no longer shrinks is the rounding error of the kernel sum
NEWTON_STEPS = 20
NEWTON_TOLERANCE = 1e-8  # of the inputs' extent; the error before the last step, which squares it
NEWTON_ROUNDING = 1e-7  # an error below this that no longer shrinks is the rounding error of the kernel sum

Nearby = Callable[[Floats], tuple[Floats, float]]
"""q (n, 2) → pixels (n, 2) near those that are mapped to q, and the longest useful step from them, in px."""


class SmoothMap(Protocol):
    """A smooth map of the plane."""

    def value(self, uv: Floats) -> Floats:
        """q at ``uv`` (n, 2): (n, 2)."""
        ...

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv at ``uv`` (n, 2): (n, 2, 2)."""
        ...


class PlaneMap(SmoothMap, Protocol):
    """A smooth map of the plane, uv (px) → q, with its uncertainty."""

    def covariance(self, uv: Floats) -> Floats:
        """Posterior covariance of q at ``uv`` (n, 2): (n, 2, 2)."""
        ...

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """The same without what a rotation of the whole camera would undo: the uncertainty of the map's shape."""
        ...

    def virtual_covariance(self, uv: Floats, by_q: Floats, by_k: Floats) -> Floats:
        """Covariance (n, 2, 2) of virtual points, without the error of a K that was not found together with the map.

        ``by_q`` (n, 2, 2) and ``by_k`` (n, 2, 3) are their derivatives by q and by K.
        """
        ...

    def covariance_root(self, uv: Floats) -> Floats:
        """A root (n, 2, r) of the covariance of all q together; r = 0 where the map has that of each q alone."""
        ...

    @property
    def disagreement(self) -> float:
        """The factor by which standard deviations exceed those due to noise alone."""
        ...

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """The uv (n, 2) that are mapped to ``q`` (n, 2); nan where none is found.

        A map that searches starts from ``nearby``.
        """
        ...

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Changes of q at ``uv`` (n, 2) for new draws of the data's noise: (draws, n, 2)."""
        ...


def propagated(jacobian: Floats, covariance: Floats) -> Floats:
    """The ``covariance`` (n, 2, 2) of inputs, as that (n, 2, 2) of outputs with the ``jacobian`` (n, 2, 2)."""
    return np.asarray(jacobian @ covariance @ jacobian.transpose(0, 2, 1))


def newton_inverse(smooth_map: SmoothMap, q: Floats, start: Floats, reach: float) -> Floats:
    """The uv (n, 2) that ``smooth_map`` maps to ``q`` (n, 2), by Newton's method from ``start``; nan where it diverges.

    Steps are at most ``reach`` px long, and a point farther than 20 of them from its start is given up.
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
        arrived = (length < INVERSE_TOLERANCE_PX) | ((length < INVERSE_ROUNDING_PX) & (length > before[active] / 2.0))
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
        """Points ``p`` (n, 2) in normalised coordinates."""
        return (p - self.offset) / self.scale

    def restore(self, p: Floats) -> Floats:
        """Normalised points ``p`` (n, 2) in the original coordinates."""
        return p * self.scale + self.offset


def scaling_of(p: Floats) -> Scaling:
    """The normalisation that brings ``p`` (n, 2) into the unit circle around their mid-range."""
    offset = (p.min(axis=0) + p.max(axis=0)) / 2.0
    return Scaling(offset, float(np.linalg.norm(p - offset, axis=1).max()))


@dataclass(frozen=True, slots=True, eq=False)
class AdditiveMap:
    """The paper's map q = mean + g(uv), with an independent GP for each output.

    ``inputs`` and ``outputs`` are the normalisations, ``mean`` (2,) is in normalised outputs.
    """

    inputs: Scaling
    outputs: Scaling
    mean: Floats
    processes: tuple[GaussianProcess, GaussianProcess]
    disagreement: ClassVar[float] = 1.0

    def value(self, uv: Floats) -> Floats:
        """q at ``uv`` (n, 2): (n, 2)."""
        x = self.inputs.normalise(uv)
        return self.outputs.restore(self.mean + np.concatenate([gp.mean(x) for gp in self.processes], axis=1))

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv at ``uv`` (n, 2): (n, 2, 2)."""
        x = self.inputs.normalise(uv)
        rows = [gp.jacobian(x) for gp in self.processes]
        return np.concatenate(rows, axis=1) * (self.outputs.scale / self.inputs.scale)

    def covariance(self, uv: Floats) -> Floats:
        """Covariance of q at ``uv`` (n, 2): (n, 2, 2), diagonal because the outputs are independent."""
        x = self.inputs.normalise(uv)
        variances = np.stack([gp.variance(x) for gp in self.processes], axis=1)
        return variances[:, :, None] * np.eye(2) * self.outputs.scale**2

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """The covariance itself: the plane is the reference board's, there is no turn."""
        return self.covariance(uv)

    def virtual_covariance(self, uv: Floats, by_q: Floats, by_k: Floats) -> Floats:
        """Covariance (n, 2, 2) of virtual points; K was not found together with the map."""
        return propagated(by_q, self.covariance(uv))

    def covariance_root(self, uv: Floats) -> Floats:
        """Empty (n, 2, 0)."""
        return np.empty((len(uv), 2, 0))

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """The uv (n, 2) of ``q`` (n, 2), by Newton's method from ``nearby``; nan where it diverges."""
        return newton_inverse(self, q, *nearby(q))

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Changes of q at ``uv`` (n, 2) for new draws of the noise: (draws, n, 2), to first order."""
        x = self.inputs.normalise(uv)
        moves = [gp.noise_response(x, np.empty((1, len(x), 0)), draws, rng) for gp in self.processes]
        return np.concatenate(moves, axis=2) * self.outputs.scale


@dataclass(frozen=True, slots=True, eq=False)
class DisplacementMap:
    """The map q = h(w) with w + g(w) = uv: ``trend`` h with parameters ``beta`` (p,), and ``process`` g.

    ``inputs`` and ``outputs`` are the normalisations.
    """

    inputs: Scaling
    outputs: Scaling
    trend: Trend
    beta: Floats
    process: GaussianProcess
    disagreement: ClassVar[float] = 1.0

    def value(self, uv: Floats) -> Floats:
        """q at ``uv`` (n, 2): (n, 2)."""
        w = self._undisplaced(self.inputs.normalise(uv))
        return self.outputs.restore(self.trend.value(self.beta, w))

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv at ``uv`` (n, 2): (n, 2, 2)."""
        return self._jacobian_at(self._undisplaced(self.inputs.normalise(uv)))

    def covariance(self, uv: Floats) -> Floats:
        """Covariance of q at ``uv`` (n, 2): (n, 2, 2), with the uncertainty of the trend's parameters."""
        w = self._undisplaced(self.inputs.normalise(uv))
        jacobian = self._jacobian_at(w)
        covariance = self.process.covariance(w, trend_features(self.trend, self.beta, w)) * self.inputs.scale**2
        return propagated(jacobian, covariance)

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """The covariance itself: the plane is the reference board's, there is no turn."""
        return self.covariance(uv)

    def virtual_covariance(self, uv: Floats, by_q: Floats, by_k: Floats) -> Floats:
        """Covariance (n, 2, 2) of virtual points; K was not found together with the map."""
        return propagated(by_q, self.covariance(uv))

    def covariance_root(self, uv: Floats) -> Floats:
        """Empty (n, 2, 0)."""
        return np.empty((len(uv), 2, 0))

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """The uv (n, 2) of ``q`` (n, 2), nan where the trend has none: only the trend has to be inverted."""
        start = self.inputs.normalise(nearby(q)[0])
        w, reached = inverse(self.trend, self.beta, self.outputs.normalise(q), start)
        uv = self.inputs.restore(self._displaced(w))
        return np.where(reached[:, None], uv, np.nan)

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Changes of q at ``uv`` (n, 2) for new draws of the noise: (draws, n, 2), to first order."""
        w = self._undisplaced(self.inputs.normalise(uv))
        features = trend_features(self.trend, self.beta, w)
        moves = self.process.noise_response(w, features, draws, rng) * self.inputs.scale
        return np.asarray(np.einsum("nij,dnj->dni", -self._jacobian_at(w), moves))  # a larger g(w), a smaller w

    def _jacobian_at(self, w: Floats) -> Floats:
        inner = inverse_2x2(np.eye(2) + self.process.jacobian(w))
        outer = self.trend.input_jacobian(self.beta, w)
        return np.asarray(outer @ inner) * (self.outputs.scale / self.inputs.scale)

    def _displaced(self, w: Floats) -> Floats:
        return np.asarray(w + self.process.mean(w))

    def _undisplaced(self, x: Floats) -> Floats:
        """The w with w + g(w) = ``x`` (n, 2), by Newton's method from the nearest training point."""
        w = np.full_like(x, np.nan)
        active = np.flatnonzero((np.abs(x) < FARTHEST).all(axis=1))
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
    """Derivative of w = h⁻¹(q) by the trend's parameters at fixed q: −(∂h/∂w)⁻¹ ∂h/∂β at ``w`` (n, 2), as (2, n, p)."""
    features = -inverse_2x2(trend.input_jacobian(beta, w)) @ trend.parameter_jacobian(beta, w)
    return np.ascontiguousarray(features.transpose(1, 0, 2))
