"""Dark discs on a light sheet: candidates, and the centroids of their images.

A disc's image is an ellipse apart from lens distortion. Its outline is measured along rays from its middle; the
integral of the grey levels from inside to outside gives each edge, which blur does not move. The resulting point is
the centroid of the area inside the outline: neither blur nor an affine map shifts it, and a camera can predict it. It
is not the image of the disc's centre; :mod:`pinholify.calibration.circles` removes the difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Floats, Ints, selected
from pinholify.detection.intensity import Grey, stretched
from pinholify.detection.saddle import sample

WINDOWS = (11, 31, 91, 271)
"""Sides (px) of the squares whose mean is the threshold between dark and light: 2 to 8 times the discs' diameters."""

DARKER_LEVELS = 8
"""A pixel is dark from this many grey levels (of 255) below that mean."""

MIN_AREA_PX2 = 20.0
"""Discs of less area have no outline to measure."""

MIN_ELLIPTICITY = 0.96
"""Smallest area of a candidate ÷ area of the ellipse with the same second moments; a square has 0.955."""

MIN_AXIS_RATIO = 0.12
"""Axis ratio of the flattest ellipse considered: a sheet seen at 83°."""

RAYS = 48
DEPTHS = 25
ITERATIONS = 3

CORRELATION_PX = 4.0
"""Length along an outline over which its errors are correlated, because neighbouring rays read the same pixels."""

RIPPLE = (0.05, 0.15)
"""An outline that differs from an ellipse by more than this share of its radius and this many px is rejected."""


@dataclass(frozen=True, slots=True, eq=False)
class Discs:
    """Discs of centroid ``uv`` (n, 2) px, whose outlines are the unit circle mapped by ``axes`` (n, 2, 2) px.

    ``std`` (n,) px is the standard deviation of the centroid, ``dark`` and ``light`` (n,) are the grey levels inside
    and around, and ``sound`` (n,) is whether the outline is an ellipse.
    """

    uv: Floats
    axes: Floats
    std: Floats
    dark: Floats
    light: Floats
    sound: Bools

    def __len__(self) -> int:
        """Number of discs."""
        return len(self.uv)

    def select(self, keep: Bools | Ints) -> Discs:
        """The discs ``keep``, a mask (n,) or positions (m,)."""
        return selected(self, keep)

    @property
    def areas(self) -> Floats:
        """Areas (n,) in px², without the factor π."""
        return np.asarray(np.linalg.det(self.axes))


def find_discs(grey: Grey) -> Discs:
    """All discs in ``grey`` (height, width), each once."""
    picture = stretched(grey)
    found = [_blobs(picture, window) for window in WINDOWS if window < min(grey.shape)]
    uv = np.concatenate([centre for centre, _ in found])
    axes = np.concatenate([axes for _, axes in found])
    discs = fit_discs(grey, uv, axes)
    return _each_once(discs.select(discs.sound))


def _blobs(picture: NDArray[np.uint8], window: int) -> tuple[Floats, Floats]:
    """Centroids (n, 2) and axes (n, 2, 2) px of the elliptical dark patches of ``picture``."""
    dark = cv2.adaptiveThreshold(picture, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, window, DARKER_LEVELS)
    contours, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    largest = 4.0 * window**2
    moments = [m for c in contours if len(c) > 8 and MIN_AREA_PX2 < (m := cv2.moments(c))["m00"] < largest]
    if not moments:
        return np.empty((0, 2)), np.empty((0, 2, 2))
    m00, m10, m01, xx, xy, yy = np.array(
        [[m[k] for k in ("m00", "m10", "m01", "mu20", "mu11", "mu02")] for m in moments]
    ).T
    covariance = np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2) / m00[:, None, None]
    values = np.linalg.eigvalsh(covariance)
    full = m00 / (4 * np.pi * np.sqrt(np.maximum(values.prod(axis=1), 1e-12)))
    kept = (full > MIN_ELLIPTICITY) & (np.sqrt(np.maximum(values[:, 0], 0) / values[:, 1]) > MIN_AXIS_RATIO)
    centre = np.stack([m10, m01], axis=1) / m00[:, None]
    return centre[kept], 2.0 * np.linalg.cholesky(covariance[kept])


def fit_discs(grey: Grey, uv: Floats, axes: Floats) -> Discs:
    """The discs near ``uv`` (n, 2) px, of about ``axes`` (n, 2, 2) px; what is not a disc is not ``sound``."""
    start = uv
    shortest = _shortest(axes)
    for _ in range(ITERATIONS):
        radius, dark, light = _outlines(grey, uv, axes)
        middle, spread = _moments(radius)
        uv = uv + (axes @ middle[:, :, None])[:, :, 0]
        axes = axes @ (2.0 * np.linalg.cholesky(spread))
    ripple = _ripple(radius)
    shortest_now = _shortest(axes)
    limit = np.maximum(RIPPLE[0], RIPPLE[1] / np.maximum(shortest_now, 1e-9))
    stayed = (np.linalg.norm(uv - start, axis=1) < shortest) & (np.abs(np.log(shortest_now / shortest)) < 0.7)
    reach = 1.2 * np.linalg.norm(axes, axis=2)
    inside = ((uv > reach) & (uv < np.array([grey.shape[1], grey.shape[0]]) - 1 - reach)).all(axis=1)
    longest = np.linalg.norm(axes, axis=(1, 2))
    independent = np.minimum(RAYS, 2 * np.pi * shortest_now / CORRELATION_PX)
    std = ripple * longest / np.sqrt(np.maximum(independent, 1.0))
    return Discs(uv, axes, std, dark, light, (ripple < limit) & stayed & inside & (light > dark))


def _shortest(axes: Floats) -> Floats:
    return np.asarray(np.linalg.svd(axes, compute_uv=False)[:, 1]) if len(axes) else np.empty(0)


@cache
def _rays() -> Floats:
    """Unit vectors (RAYS, 2)."""
    angle = np.arange(RAYS) * (2 * np.pi / RAYS)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


@cache
def _level_fit() -> Floats:
    """The projection (RAYS, RAYS) on grey levels that vary linearly across a disc."""
    design = np.column_stack([np.ones(RAYS), _rays()])
    return np.asarray(design @ np.linalg.pinv(design))


def _outlines(grey: Grey, uv: Floats, axes: Floats) -> tuple[Floats, Floats, Floats]:
    """Radius (n, RAYS) of the edge along each ray, 1 on the ellipse of ``axes``; grey inside and around, (n,) each."""
    half = np.clip(3.0 / np.maximum(_shortest(axes), 1e-9), 0.2, 0.45)
    depth = 1.0 + half[:, None] * np.linspace(-1.0, 1.0, DEPTHS)
    place = depth[:, :, None, None] * _rays()  # (n, DEPTHS, RAYS, 2)
    values = sample(grey, uv[:, None, None] + place @ axes.transpose(0, 2, 1)[:, None])
    dark = values[:, :3].mean(axis=1) @ _level_fit()
    light = values[:, -3:].mean(axis=1) @ _level_fit()
    contrast = np.where(np.abs(light - dark) < 1e-6, 1e-6, light - dark)
    share = np.clip((light[:, None] - values) / contrast[:, None], -0.5, 1.5)
    weight = np.full(DEPTHS, 1.0)
    weight[[0, -1]] = 0.5
    inside = np.einsum("d,ndr->nr", weight, share) * (2.0 / (DEPTHS - 1))
    return 1.0 + half[:, None] * (np.clip(inside, 0.0, 2.0) - 1.0), dark.mean(axis=1), light.mean(axis=1)


def _moments(radius: Floats) -> tuple[Floats, Floats]:
    """Centroid (n, 2) and covariance (n, 2, 2) of the area inside the outlines ``radius`` (n, RAYS)."""
    rays = _rays()
    area = (radius**2 / 2).mean(axis=1)
    middle = (radius[:, :, None] ** 3 / 3 * rays).mean(axis=1) / area[:, None]
    second = np.einsum("nr,ri,rj->nij", radius**4 / 4, rays, rays) / RAYS / area[:, None, None]
    return middle, second - middle[:, :, None] * middle[:, None]


@cache
def _harmonics() -> Floats:
    """The projection (RAYS, RAYS) that removes all ellipses near the unit circle, to first order."""
    angle = np.arange(RAYS) * (2 * np.pi / RAYS)
    design = np.column_stack([np.ones(RAYS), *(f(k * angle) for k in (1, 2) for f in (np.cos, np.sin))])
    return np.asarray(np.eye(RAYS) - design @ np.linalg.pinv(design))


def _ripple(radius: Floats) -> Floats:
    """RMS (n,) deviation of the outlines from ellipses, as a share of the radius."""
    return np.asarray(np.sqrt(((radius @ _harmonics()) ** 2).mean(axis=1)))


def _each_once(discs: Discs) -> Discs:
    """``discs`` without those whose centroid lies inside another, more accurate one."""
    order = np.argsort(discs.std / np.sqrt(np.maximum(discs.areas, 1e-9)))
    taken = np.zeros(len(discs), dtype=bool)
    kept = []
    for k in order:
        if taken[k]:
            continue
        kept.append(k)
        apart = np.linalg.norm(np.linalg.solve(discs.axes[k], (discs.uv - discs.uv[k]).T), axis=0)
        taken |= apart < 1.0
    return discs.select(np.array(sorted(kept), dtype=np.int64))
