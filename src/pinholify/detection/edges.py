"""Corner positions to a few hundredths of a pixel: a corner as the crossing of two blurred edges.

The grey levels around a corner are fitted with

I(s, t) = c₀ + c₁s + c₂t + (κ + κ₁s + κ₂t) · E(s - d - αt) · E(t - e - βs),

where E is the error function of a blur b, and (s, t) are coordinates that follow the board's own curved lines. A
quadratic fit of the same window (:mod:`pinholify.detection.saddle`) is shifted by shading, which tilts the surface, and
averages noise over squares that carry no information about the position; here shading has its own terms, and only the
edges count. All eleven parameters are fitted by Gauss-Newton, with weights that suppress what does not belong to the
corner: a finger, a marker, the image's border.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from pinholify.arrays import Bools, Floats, Ints, joined, selected
from pinholify.detection.intensity import Grey
from pinholify.detection.windows import Samples, Windows, read, worth_reading

BLOCK_SAMPLES = 12_000
"""Samples read at a time: as many as fit in a processor's cache."""

ROUGH_SAMPLES = 400
"""Samples per window that the fit starts with."""

ITERATIONS = 6

SETTLED_PX = 0.03
"""The fit ends after a shorter step: convergence is quadratic, and the next one would be negligible."""

FIRST_BLUR_PX = 1.0
"""Initial standard deviation of the edges' blur."""

MIN_SHAPE = np.array([-1.0, -1.0, -0.7, -0.7, np.log(0.3)])
GREATEST_SHAPE = np.array([1.0, 1.0, 0.7, 0.7, np.log(8.0)])
"""Limits of d, e, α, β and log blur (px)."""

OUTLIER = 3.0
"""Tukey's biweight vanishes at twice this many times the window's own scale of residuals."""

TOLERATED_MISFIT = 0.03
"""Errors of the model and of interpolation near the edges, as a fraction of κ, which are not outliers."""

SCALE_STRIDE = 3
"""The scale of the residuals is estimated from every third sample."""

MIN_WEIGHT_SHARE = 0.3
"""Smallest share of the samples' total weight that a fit has to keep."""

MIN_SPREAD = 0.01
"""Lower bound of the scale of residuals, as a fraction of κ."""


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Fitted corners ``uv`` (n, 2) px with standard deviations ``std`` (n,) px.

    ``strength`` (n,) is κ, signed, and ``residual`` (n,) the robust scale of the fit's residuals, both in grey levels;
    ``sound`` (n,) is whether the fit can be used, and ``half`` (n,) px the half side of its window.
    """

    uv: Floats
    std: Floats
    strength: Floats
    residual: Floats
    sound: Bools
    half: Floats

    def select(self, keep: Ints) -> Crossings:
        """The corners at the positions ``keep``."""
        return selected(self, keep)

    def replaced(self, where: Ints, others: Crossings) -> Crossings:
        """The same corners, with ``others`` at the positions ``where``."""
        together = joined([self, others])
        order = np.arange(len(self.uv))
        order[where] = len(self.uv) + np.arange(len(others.uv))
        return together.select(order)


def fit_crossings(grey: Grey, windows: Windows) -> Crossings:
    """The fits of the two edges in each of ``windows`` (one or more).

    They start with few samples, because the cost of a step is proportional to their number.
    """
    order = np.argsort(-windows.area, kind="stable")  # windows of similar size share a number of samples
    ordered = windows.select(order)
    few = np.full(len(order), ROUGH_SAMPLES)
    rough = joined([_fitted(*each) for each in _blocks(grey, ordered, _start(len(order)), few)])
    fine = [_crossings(*each[:2], _fitted(*each)) for each in _blocks(grey, ordered, rough, worth_reading(ordered))]
    return joined(fine).select(np.argsort(order))


def _blocks(grey: Grey, windows: Windows, fits: _Fit, counts: Ints) -> Iterator[tuple[Windows, Samples, _Fit]]:
    """Blocks of ``windows`` that fit in the cache, with their samples and their ``fits``.

    ``counts`` (n,) are the numbers of samples to read, in descending order; a block uses that of its first window.
    """
    first = 0
    while first < len(counts):
        count = int(counts[first])
        block = np.arange(first, min(first + max(1, BLOCK_SAMPLES // count), len(counts)))
        part = windows.select(block)
        yield part, read(grey, part, count), selected(fits, block)
        first = int(block[-1]) + 1


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """``shape`` (n, 5): d, e, α, β in units of the window and log b, b in px; ``linear`` (n, 6): c₀ to κ₂.

    ``step`` (n, 5) is the last step, ``spread`` (n,) the residuals' scale, ``normal`` (n, 11, 11) the normal matrix.
    """

    shape: Floats
    linear: Floats
    step: Floats
    spread: Floats
    normal: Floats

    @property
    def strength(self) -> Floats:
        """κ (n,), never zero."""
        return _nonzero(self.linear[:, 3])


def _nonzero(strength: Floats) -> Floats:
    return np.where(np.abs(strength) < 1e-6, 1e-6, strength)


def _start(count: int) -> _Fit:
    """Two edges along the windows' axes, before any grey levels are read."""
    shape = np.zeros((count, 5))
    shape[:, 4] = np.log(FIRST_BLUR_PX)
    return _Fit(shape, np.zeros((count, 6)), np.zeros((count, 5)), np.full(count, np.inf), np.zeros((count, 11, 11)))


def _fitted(windows: Windows, samples: Samples, fit: _Fit) -> _Fit:
    """``fit`` improved on ``samples`` by reweighted Gauss-Newton steps."""
    scale = np.linalg.norm(windows.axes, axis=1)
    for _ in range(ITERATIONS):
        design = _design(fit.shape, scale, samples)
        misfit = samples.values - (fit.linear[:, None] @ design[:, :6])[:, 0]
        fit = _step(samples, design, _robust_weights(misfit, fit, samples.inside), fit.shape)
        if (np.abs(fit.step[:, :2]) * scale).max(initial=0.0) < SETTLED_PX:
            break
    return fit


def _robust_weights(misfit: Floats, fit: _Fit, inside: Bools) -> Floats:
    """Tukey's weights (n, m), or equal ones where a step has gone so far that hardly any weight would be left."""
    end = 2 * OUTLIER * (fit.spread + TOLERATED_MISFIT * np.abs(fit.linear[:, 3]))
    weight = inside * np.clip(1 - (misfit / end[:, None]) ** 2, 0.0, None) ** 2
    lost = weight.sum(axis=1) < MIN_WEIGHT_SHARE * inside.sum(axis=1)
    return np.where(lost[:, None], inside, weight)


def _step(samples: Samples, design: Floats, weight: Floats, shape: Floats) -> _Fit:
    weighted = design * weight[:, None]
    normal = np.asarray(weighted @ design.transpose(0, 2, 1))
    normal += 1e-9 * np.einsum("nii->n", normal)[:, None, None] * np.eye(11)
    solution: Floats = np.asarray(np.linalg.solve(normal, weighted @ samples.values[:, :, None])[:, :, 0], np.float64)
    residual = samples.values - (solution[:, None] @ design)[:, 0]
    scatter = 1.4826 * np.median(np.abs((residual * samples.inside)[:, ::SCALE_STRIDE]), axis=1)
    strength = _nonzero(solution[:, 3])
    step = solution[:, 6:] / strength[:, None]
    shape = np.clip(shape + np.clip(step, -0.25, 0.25), MIN_SHAPE, GREATEST_SHAPE)
    return _Fit(shape, solution[:, :6], step, scatter + MIN_SPREAD * np.abs(strength), normal)


def _design(shape: Floats, scale: Floats, samples: Samples) -> Floats:
    """The design (n, 11, m): the six linear terms, then the derivatives by d, e, α, β and log b per unit of κ."""
    s, t = samples.s, samples.t
    d, e, alpha, beta, log_blur = (column[:, None] for column in shape.T)
    across_s, across_t = s - d - alpha * t, t - e - beta * s
    blur = np.exp(log_blur)
    edge_s, slope_s = _edge(across_s, blur / scale[:, :1])
    edge_t, slope_t = _edge(across_t, blur / scale[:, 1:])
    design = np.empty((len(shape), 11, s.shape[1]))
    design[:, 0], design[:, 1], design[:, 2] = 1.0, s, t
    both, by_d, by_e = design[:, 3], design[:, 6], design[:, 7]
    np.multiply(edge_s, edge_t, out=both)
    np.multiply(s, both, out=design[:, 4])
    np.multiply(t, both, out=design[:, 5])
    np.multiply(-slope_s, edge_t, out=by_d)
    np.multiply(edge_s, -slope_t, out=by_e)
    np.multiply(t, by_d, out=design[:, 8])
    np.multiply(s, by_e, out=design[:, 9])
    design[:, 10] = across_s * by_d + across_t * by_e
    return design


def _edge(x: Floats, blur: Floats) -> tuple[Floats, Floats]:
    """The blurred step from -1 to 1 at ``x``, and its derivative."""
    z = x / blur
    return erf(z / np.sqrt(2.0)), np.sqrt(2.0 / np.pi) * np.exp(-z * z / 2) / blur


def _crossings(windows: Windows, samples: Samples, fit: _Fit) -> Crossings:
    shape, strength = fit.shape, fit.strength
    # The edges s = d + αt and t = e + βs cross at:
    d, e, alpha, beta = shape[:, :4].T
    across = 1 - alpha * beta
    s, t = (d + alpha * e) / across, (e + beta * d) / across
    st = np.stack([s, t], axis=1)
    shift = (windows.axes @ st[:, :, None])[:, :, 0]
    shift += (windows.bend @ np.stack([s * s, s * t, t * t], axis=1)[:, :, None])[:, :, 0]
    of_d_and_e = np.linalg.solve(fit.normal, np.eye(11)[None, :, 6:8])[:, 6:8]
    covariance = of_d_and_e * (samples.shared * (fit.spread / strength) ** 2)[:, None, None]
    spatial = windows.axes @ covariance @ windows.axes.transpose(0, 2, 1)
    std = np.sqrt(np.maximum(np.einsum("nii->n", spatial) / 2, 0.0))
    scale = np.linalg.norm(windows.axes, axis=1)
    settled = (np.abs(fit.step[:, :2]) * scale < 0.1).all(axis=1)
    sound = settled & (np.abs(st) < 0.5).all(axis=1) & (np.abs(shape[:, 2:4]) < 0.6).all(axis=1)
    return Crossings(windows.uv + shift, std, strength, fit.spread, sound & np.isfinite(std), np.sqrt(windows.area) / 2)
