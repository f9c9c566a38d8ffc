"""Sub-pixel corner positions: where a chessboard's grey levels have their saddle point.

All functions take a float32 grey image (height, width), positions uv (N, 2) in px and a frame (N, 2, 2) per corner,
whose columns are the half axes of its window in px, along the board's lines where these are known. Windows are sampled
on one normalised grid (s, t) ∈ [-1, 1]², so a fit is the same small linear map for every corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.detection.intensity import Grey

SAMPLES = 15
"""Grid points along a side of a window."""

ITERATIONS = 8

SETTLED_PX = 0.01
"""A corner that moves less in one step has converged; one that still moves by ten times this is not sound."""


@dataclass(frozen=True, slots=True, eq=False)
class Saddles:
    """Saddle points at ``uv`` (N, 2) px, each with its frame.

    ``strength`` (N,): the fitted coefficient of s·t in grey levels, positive if the squares at (+s, +t) and (-s, -t)
    are the bright ones. ``residual`` (N,): RMS of the fit in grey levels. ``sound`` (N,): whether the fit converged to
    a saddle within its window.
    """

    uv: Floats
    strength: Floats
    residual: Floats
    sound: Bools


@cache
def _grid() -> Floats:
    side = np.linspace(-1.0, 1.0, SAMPLES)
    s, t = np.meshgrid(side, side)
    return np.stack([s.ravel(), t.ravel()], axis=1)


@cache
def _quadratic_fit() -> tuple[Floats, Floats, Floats]:
    """Design (n², 6) of 1, s, t, s²/2, st, t²/2, the weighted least-squares operator (6, n²), and the weights (n²,)."""
    s, t = _grid().T
    design = np.stack([np.ones_like(s), s, t, s * s / 2, s * t, t * t / 2], axis=1)
    weight = np.exp(-(s * s + t * t) / (2 * 0.5**2))
    operator = np.linalg.solve(design.T @ (weight[:, None] * design), design.T * weight)
    return design, operator, weight / weight.sum()


def sample(grey: Grey, uv: Floats) -> Floats:
    """Grey levels (...) at ``uv`` (..., 2) px by bilinear interpolation; the border is repeated outside."""
    height, width = grey.shape
    u = np.clip(uv[..., 0], 0.0, width - 1.0 - 1e-9 * width)
    v = np.clip(uv[..., 1], 0.0, height - 1.0 - 1e-9 * height)
    left, top = u.astype(np.intp), v.astype(np.intp)
    u -= left
    v -= top
    corner = top * width + left
    flat = grey.ravel()
    upper = flat.take(corner) * (1 - u) + flat.take(corner + 1) * u
    corner += width
    lower = flat.take(corner) * (1 - u) + flat.take(corner + 1) * u
    return np.asarray(upper + (lower - upper) * v)


def windows(grey: Grey, uv: Floats, frames: Floats) -> Floats:
    """Grey levels (N, SAMPLES²) in the windows of ``uv``."""
    return sample(grey, uv[:, None, :] + _grid() @ frames.transpose(0, 2, 1))


def refine_saddles(grey: Grey, uv: Floats, frames: Floats) -> Saddles:
    """Each of ``uv`` moved to the saddle point of a weighted quadratic fit, re-centred until it converges.

    A surface that is even about the corner has no linear term whatever its profile, so neither blur nor the sharpness
    of the edges biases the re-centred fit; only shading and curved edges shift it, with the square of the window.
    """
    design, operator, weight = _quadratic_fit()
    place = np.array(uv, dtype=np.float64)
    last_step = np.full(len(place), np.inf)
    coefficients, residual = np.zeros((len(place), 6)), np.full(len(place), np.inf)
    sound = np.ones(len(place), dtype=bool)
    for _ in range(ITERATIONS):
        active = np.flatnonzero((last_step > SETTLED_PX) & sound)
        if not len(active):
            break
        patch = windows(grey, place[active], frames[active])
        fit = patch @ operator.T
        coefficients[active] = fit
        residual[active] = np.sqrt(((patch - fit @ design.T) ** 2) @ weight)
        step, saddle = _newton_step(fit)
        shift = (frames[active] @ step[:, :, None])[:, :, 0]
        place[active] += shift
        last_step[active] = np.linalg.norm(shift, axis=1)
        moved = np.linalg.solve(frames[active], (place[active] - uv[active])[:, :, None])[:, :, 0]
        sound[active] = saddle & (np.abs(moved) < 1.0).all(axis=1)
    return Saddles(place, coefficients[:, 4], residual, sound & (last_step < 10 * SETTLED_PX))


def saddle_strength(grey: Grey, uv: Floats, frames: Floats) -> Floats:
    """The ``strength`` (N,) of :class:`Saddles` at ``uv`` (N, 2) px, without moving them."""
    return np.asarray(windows(grey, uv, frames) @ _quadratic_fit()[1][4])


def _newton_step(fit: Floats) -> tuple[Floats, Bools]:
    """The step (N, 2) from the window's centre to the saddle, at most half a window, and whether it is a saddle."""
    _, gs, gt, hss, hst, htt = fit.T
    determinant = hss * htt - hst * hst
    saddle = determinant < 0
    safe = np.where(saddle, determinant, -1.0)
    step = np.stack([(hst * gt - htt * gs) / safe, (hst * gs - hss * gt) / safe], axis=1)
    return np.clip(np.where(saddle[:, None], step, 0.0), -0.5, 0.5), saddle
