"""Corner positions to a few hundredths of a pixel: a corner as the crossing of two blurred edges.

Around a corner the grey levels are fitted with

I(s, t) = c₀ + c₁s + c₂t + (κ + κ₁s + κ₂t) · E(s - d - αt) · E(t - e - βs),

E the error function of a blur b, (s, t) coordinates that follow the board's own curved lines. A quadratic fit
of the same window (:mod:`pinholify.detection.saddle`) is shifted by shading, which tilts the surface, and
averages noise over squares that say nothing about the place; here shading has its own terms, and only the
edges speak. Gauss-Newton on all eleven numbers, with weights that forget what does not belong to the corner:
a finger, a marker, the image's end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.special import erf

from pinholify.arrays import Bools, Floats, Ints
from pinholify.detection.intensity import Grey
from pinholify.detection.saddle import sample

SAMPLES = 730
"""Places in a window where the grey levels are read."""

BLOCK = 16
"""Windows fitted at a time: as many as fit a processor's cache."""

ITERATIONS = 6

SETTLED = 0.003
"""Steps (px) below which the fit is done."""

FIRST_BLUR = 1.0
"""Standard deviation (px) of the edges' blur to start from."""

LEAST = np.array([-1.0, -1.0, -0.7, -0.7, np.log(0.3)])
GREATEST = np.array([1.0, 1.0, 0.7, 0.7, np.log(8.0)])
"""Limits of d, e, α, β and log blur (px)."""

OUTLIER = 3.0
"""Residuals beyond this many times the window's own scale lose weight (Tukey's biweight ends at twice that).
"""


LEAST_SPREAD = 0.01
"""What the model itself, and interpolation, miss near the edges, as a fraction of κ: no outliers, these."""


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Fitted corners: ``uv`` (n, 2) px, its standard deviation ``std`` (n,) px, signed ``strength`` κ in grey
    levels, ``residual`` (n,) the fit's robust scale in grey levels, and whether the fit is ``sound`` (n,).
    """

    uv: Floats
    std: Floats
    strength: Floats
    residual: Floats
    sound: Bools

    def select(self, keep: Ints) -> Crossings:
        """The corners at the positions ``keep``."""
        return Crossings(*(field[keep] for field in self._fields()))

    def replaced(self, where: Ints, others: Crossings) -> Crossings:
        """The same corners, with ``others`` at the positions ``where``."""
        fields = []
        for mine, other in zip(self._fields(), others._fields(), strict=True):
            mine = mine.copy()
            mine[where] = other
            fields.append(mine)
        return Crossings(*fields)

    def _fields(self) -> tuple[Any, ...]:
        return self.uv, self.std, self.strength, self.residual, self.sound


def _joined(parts: Sequence[Crossings]) -> Crossings:
    """The corners of all ``parts``, one after the other."""
    return Crossings(*map(np.concatenate, zip(*(part._fields() for part in parts), strict=True)))


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Where to fit: corners ``uv`` (n, 2) px, ``axes`` (n, 2, 2) px a window's half side, ``bend`` (n, 2, 3)
    px.

    The point (s, t) of a window lies at uv + axes·(s, t) + bend·(s², st, t²).
    """

    uv: Floats
    axes: Floats
    bend: Floats

    def scaled(self, factor: float) -> Windows:
        """The same windows, ``factor`` times as wide."""
        return Windows(self.uv, self.axes * factor, self.bend * factor**2)

    def select(self, keep: Ints) -> Windows:
        """The windows at the positions ``keep``."""
        return Windows(self.uv[keep], self.axes[keep], self.bend[keep])

    def places(self) -> Floats:
        """(n, SAMPLES, 2) px of the places to read."""
        s, t = _places()
        linear = np.stack([s, t], axis=1) @ self.axes.transpose(0, 2, 1)
        bent = np.stack([s * s, s * t, t * t], axis=1) @ self.bend.transpose(0, 2, 1)
        return self.uv[:, None] + linear + bent


@cache
def _places() -> Floats:
    """(2, SAMPLES) points (s, t) that fill a window evenly and symmetrically, no two on one line.

    On a regular grid all samples along an edge that runs with the pixels' rows would share one fraction of a
    pixel, and with it one error of interpolation. (The additive sequence of the plastic number; Roberts,
    2018.)
    """
    plastic = 1.324717957244746
    steps = np.arange(1, SAMPLES // 2 + 1)
    half = np.stack([steps / plastic % 1.0, steps / plastic**2 % 1.0]) * 2 - 1
    return np.concatenate([half, -half], axis=1)


def fit_crossings(grey: Grey, windows: Windows) -> Crossings:
    """Fits the two edges in each of ``windows``."""
    count = len(windows.uv)
    blocks = np.array_split(np.arange(count), max(1, -(-count // BLOCK)))
    return _joined([_fit_block(grey, windows.select(block)) for block in blocks])


def _fit_block(grey: Grey, windows: Windows) -> Crossings:
    places = windows.places()
    size = np.array([grey.shape[1], grey.shape[0]]) - 1
    inside = np.asarray(((places >= 0) & (places <= size)).all(axis=2))
    values = sample(grey, places)
    scale = np.linalg.norm(windows.axes, axis=1)
    # Columns: d, e, alpha, beta in units of the window, log of the blur in px.
    shape = np.zeros((len(values), 5))
    shape[:, 4] = np.log(FIRST_BLUR)
    weight = inside.astype(np.float64)
    for _ in range(ITERATIONS):
        design = _design(shape, scale)
        weighted = design * weight[:, None]
        normal = np.asarray(weighted @ design.transpose(0, 2, 1))
        normal += 1e-9 * np.einsum("nii->n", normal)[:, None, None] * np.eye(11)
        solution = np.linalg.solve(normal, weighted @ values[:, :, None])
        residual = values - (solution.transpose(0, 2, 1) @ design)[:, 0]
        solution = solution[:, :, 0]
        strength = np.where(np.abs(solution[:, 3]) < 1e-6, 1e-6, solution[:, 3])
        step = solution[:, 6:] / strength[:, None]
        shape = np.clip(shape + np.clip(step, -0.25, 0.25), LEAST, GREATEST)
        scatter = 1.4826 * np.median(np.abs(residual * inside), axis=1)
        spread = scatter + LEAST_SPREAD * np.abs(strength)
        if (np.abs(step[:, :2]) * scale).max(initial=0.0) < SETTLED:
            break
        ratio = residual / (2 * OUTLIER * spread[:, None])
        weight = np.asarray(inside * np.clip(1 - ratio**2, 0.0, None) ** 2)
    return _crossings(windows, shape, strength, spread, normal, step, scale)


def _design(shape: Floats, scale: Floats) -> Floats:
    """(n, 11, SAMPLES): the six linear terms, then the derivatives by d, e, α, β and log b, each per unit of
    κ.
    """
    s, t = _places()
    d, e, alpha, beta, log_blur = (column[:, None] for column in shape.T)
    across_s, across_t = s - d - alpha * t, t - e - beta * s
    blur = np.exp(log_blur)
    edge_s, slope_s = _edge(across_s, blur / scale[:, :1])
    edge_t, slope_t = _edge(across_t, blur / scale[:, 1:])
    design = np.empty((len(shape), 11, SAMPLES))
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
    """The blurred step from -1 to 1 at ``x``, and its slope."""
    z = x / blur
    return erf(z / np.sqrt(2.0)), np.sqrt(2.0 / np.pi) * np.exp(-z * z / 2) / blur


def _crossings(
    windows: Windows,
    shape: Floats,
    strength: Floats,
    spread: Floats,
    normal: Floats,
    step: Floats,
    scale: Floats,
) -> Crossings:
    # The edges s = d + αt and t = e + βs cross at:
    d, e, alpha, beta = shape[:, :4].T
    across = 1 - alpha * beta
    s, t = (d + alpha * e) / across, (e + beta * d) / across
    st = np.stack([s, t], axis=1)
    shift = (windows.axes @ st[:, :, None])[:, :, 0]
    shift += (windows.bend @ np.stack([s * s, s * t, t * t], axis=1)[:, :, None])[:, :, 0]
    covariance = np.linalg.inv(normal)[:, 6:8, 6:8] * ((spread / strength) ** 2)[:, None, None]
    spatial = windows.axes @ covariance @ windows.axes.transpose(0, 2, 1)
    std = np.sqrt(np.maximum(np.einsum("nii->n", spatial) / 2, 0.0))
    settled = (np.abs(step[:, :2]) * scale < 0.1).all(axis=1)
    sound = settled & (np.abs(st) < 0.5).all(axis=1) & (np.abs(shape[:, 2:4]) < 0.6).all(axis=1)
    return Crossings(windows.uv + shift, std, strength, spread, sound & np.isfinite(std))
