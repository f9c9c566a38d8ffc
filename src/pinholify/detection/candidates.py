"""Candidate checkerboard corners: saddle points of the smoothed grey levels with four alternating sectors.

The Hessian of a blurred corner I = f(n₁·x) f(n₂·x) is proportional to n₁n₂ᵀ + n₂n₁ᵀ, so its determinant is
negative, and the two directions in which it vanishes are the corner's edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.detection.intensity import Grey

BLUR = 1.5
"""Standard deviation (px) of the smoothing before second derivatives are taken."""

RING_RADIUS = 4.0
"""Radius (px) of the circle on which the sectors are counted: it stays inside squares of 8 px or more."""

RING_SAMPLES = 32

MAX_CANDIDATES = 20_000
"""Saddles considered, the strongest; photographs of gravel have far more."""

CONTRAST_PIXELS = 100_000
"""Evenly spread pixels from which the range and the noise of an image's grey levels are estimated."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Candidates at ``uv`` (n, 2) px: ``hessian`` (n, 2, 2) of the smoothed grey levels, ``contrast`` (n,).

    ``edges`` (n, 2, 2) holds the unit directions a, b of the two edges as columns, b clockwise of a, such that the
    squares between a and b and between -a and -b are bright. Neighbouring corners of a board therefore have their a and
    b exchanged.
    """

    uv: Floats
    hessian: Floats
    contrast: Floats
    edges: Floats

    def __len__(self) -> int:
        """Number of candidates."""
        return len(self.uv)


def find_candidates(grey: Grey) -> Candidates:
    """All candidates in ``grey`` (height, width)."""
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), BLUR), dtype=np.float32)
    least_contrast = _least_contrast(grey)
    uv, hessian = _saddles(smooth, least_contrast)
    contrast, alternating = _ring_test(smooth, uv)
    kept = alternating & (contrast > least_contrast)
    return Candidates(uv[kept], hessian[kept], contrast[kept], _edge_directions(hessian[kept]))


def _least_contrast(grey: Grey) -> float:
    """Grey levels by which a corner's sectors must differ: three times the noise, and 3 % of the image's range."""
    step = int(np.ceil(np.sqrt(grey.size / CONTRAST_PIXELS)))
    low, high = np.percentile(grey[::step, ::step], [1, 99])
    rows = grey[:: step * step]
    noise = 1.4826 * np.median(np.abs(rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:])) / np.sqrt(6.0)
    return float(max(0.03 * (high - low), 3.0 * noise, 1e-6))


def _saddles(smooth: Grey, least_contrast: float) -> tuple[Floats, Floats]:
    """Positions (n, 2) and Hessians (n, 2, 2) of the local maxima of -det(Hessian), refined by one Newton step."""
    xx = cv2.filter2D(smooth, -1, np.array([[1.0, -2.0, 1.0]], np.float32))
    yy = cv2.filter2D(smooth, -1, np.array([[1.0], [-2.0], [1.0]], np.float32))
    xy = cv2.filter2D(smooth, -1, np.array([[1, 0, -1], [0, 0, 0], [-1, 0, 1]], np.float32) / 4)
    saddleness = xy * xy - xx * yy
    # A right-angled corner of contrast c has -det(Hessian) = (c / (π σ²))²; slanted ones have less.
    threshold = (0.15 * least_contrast / (np.pi * BLUR**2)) ** 2
    peak = (saddleness > threshold) & (saddleness >= cv2.dilate(saddleness, np.ones((5, 5), np.uint8)))
    peak[:3], peak[-3:], peak[:, :3], peak[:, -3:] = False, False, False, False
    v, u = np.nonzero(peak)
    if len(u) > MAX_CANDIDATES:
        strongest = np.argpartition(-saddleness[v, u], MAX_CANDIDATES)[:MAX_CANDIDATES]
        v, u = v[strongest], u[strongest]
    right, down = smooth[v, u + 1] - smooth[v, u - 1], smooth[v + 1, u] - smooth[v - 1, u]
    gradient = np.stack([right, down], axis=1) / 2.0
    a, b, c = (np.asarray(part[v, u], dtype=np.float64) for part in (xx, xy, yy))
    hessian = np.stack([a, b, b, c], axis=1).reshape(-1, 2, 2)
    step = -np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]
    return np.stack([u, v], axis=1) + np.clip(step, -1.5, 1.5), hessian


def _ring_test(smooth: Grey, uv: Floats) -> tuple[Floats, Bools]:
    """Contrast (n,) of the sectors around ``uv`` (n, 2), and whether they are four alternating, symmetric ones (n,)."""
    if not len(uv):
        return np.zeros(0), np.zeros(0, dtype=bool)
    angle = np.arange(RING_SAMPLES) * (2 * np.pi / RING_SAMPLES)
    circle = RING_RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places = np.asarray(uv[:, None] + circle, dtype=np.float32)
    ring = cv2.remap(smooth, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    half = RING_SAMPLES // 2
    even, odd = (ring[:, :half] + ring[:, half:]) / 2, (ring[:, :half] - ring[:, half:]) / 2
    bright = even > (even.max(axis=1, keepdims=True) + even.min(axis=1, keepdims=True)) / 2
    changes = (bright != np.roll(bright, 1, axis=1)).sum(axis=1)
    count = bright.sum(axis=1)
    mean_bright = (even * bright).sum(axis=1) / np.maximum(count, 1)
    mean_dark = (even * ~bright).sum(axis=1) / np.maximum(half - count, 1)
    symmetric = (odd**2).sum(axis=1) < 0.35 * ((even - even.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    return mean_bright - mean_dark, (changes == 2) & symmetric


def _edge_directions(hessian: Floats) -> Floats:
    """The unit vectors a, b (columns of (n, 2, 2)) with aᵀHa = bᵀHb = 0, aᵀHb > 0 and b clockwise of a."""
    if not len(hessian):
        return np.empty((0, 2, 2))
    value, vector = np.linalg.eigh(hessian)
    vector[:, :, 1] *= np.sign(np.linalg.det(vector))[:, None]
    low, high = np.sqrt(np.maximum(-value[:, :1], 0.0)), np.sqrt(np.maximum(value[:, 1:], 0.0))
    # With orthonormal v₀, v₁ to the values -low², high²: (high·v₀ ± low·v₁) are the null directions.
    v0, v1 = high * vector[:, :, 0], low * vector[:, :, 1]
    edges = np.stack([v1 + v0, v1 - v0], axis=2)
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    flip = np.linalg.det(edges) < 0
    edges[flip] = edges[flip][:, :, ::-1]
    return np.asarray(edges)


def neighbours(candidates: Candidates) -> Ints:
    """For each candidate the next one along +a, +b, -a, -b with matching edges and colours, or -1: (n, 4)."""
    from scipy.spatial import cKDTree

    count = len(candidates)
    if count < 5:
        return np.full((count, 4), -1)
    distance, other = cKDTree(candidates.uv).query(candidates.uv, k=min(25, count))
    distance, other = distance[:, 1:], other[:, 1:]
    direction = (candidates.uv[other] - candidates.uv[:, None]) / np.maximum(distance, 1e-9)[:, :, None]
    a, b = candidates.edges[:, :, 0], candidates.edges[:, :, 1]
    result = np.full((count, 4), -1)
    for side, (mine, across) in enumerate([(a, b), (b, a), (-a, b), (-b, a)]):
        # Edges are exchanged from corner to corner: what is a here is b there.
        along_other, across_other = (b, a) if side % 2 == 0 else (a, b)
        fits = (
            ((direction * mine[:, None]).sum(axis=2) > 0.93)
            & (np.abs((direction * along_other[other]).sum(axis=2)) > 0.93)
            & (np.abs((across[:, None] * across_other[other]).sum(axis=2)) > 0.8)
            & (candidates.contrast[other] > 0.3 * candidates.contrast[:, None])
        )
        reach = np.where(fits, distance, np.inf)
        best = reach.argmin(axis=1)
        rows = np.arange(count)
        result[:, side] = np.where(np.isfinite(reach[rows, best]), other[rows, best], -1)
    return result
