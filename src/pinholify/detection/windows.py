"""Windows around corners, and the places where their grey levels are read: densest along the lines that cross there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from pinholify.arrays import Bools, Floats, Ints, selected
from pinholify.detection.intensity import Grey
from pinholify.detection.saddle import sample

FEWEST_SAMPLES, MOST_SAMPLES = 700, 2400
"""Numbers of samples per window; the errors of interpolation do not average out over fewer."""

DENSITY = 1.2
"""Samples per px² that are worth reading."""

BAND_PX = 5.0
"""Half width of the bands along the two lines that stay dense where a window is too wide to be dense all over."""

MAX_BAND_SHARE = 1 / 3
"""Largest share of the samples that is reserved for the band along one line."""

INDEPENDENT_DENSITY = 0.45
"""Samples per px² up to which they are independent: interpolated neighbours share their pixels' noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Curved windows around corners ``uv`` (n, 2) px: half sides ``axes`` (n, 2, 2) px and ``bend`` (n, 2, 3) px.

    The point (s, t) ∈ [-1, 1]² of a window lies at uv + axes·(s, t) + bend·(s², st, t²).
    """

    uv: Floats
    axes: Floats
    bend: Floats

    def scaled(self, factor: float) -> Windows:
        """The same windows, ``factor`` times as wide."""
        return replace(self, axes=self.axes * factor, bend=self.bend * factor**2)

    def select(self, keep: Ints) -> Windows:
        """The windows at the positions ``keep`` (m,)."""
        return selected(self, keep)

    @property
    def area(self) -> Floats:
        """Areas (n,) in px²."""
        return np.asarray(4.0 * np.abs(np.linalg.det(self.axes)))

    def at(self, s: Floats, t: Floats) -> Floats:
        """u and v (n, 2, m) in px of the points ``s`` and ``t`` (n, m)."""
        powers = np.stack([np.ones_like(s), s, t, s * s, s * t, t * t], axis=1)
        return np.asarray(np.concatenate([self.uv[:, :, None], self.axes, self.bend], axis=2) @ powers)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples of n windows: grey ``values`` (n, m) at ``s`` and ``t`` (n, m), and which are ``inside`` the image.

    ``shared`` (n,) is the number of samples along the lines that carry the information of one.
    """

    s: Floats
    t: Floats
    values: Floats
    inside: Bools
    shared: Floats


def worth_reading(windows: Windows) -> Ints:
    """Number (n,) of samples worth reading in each of ``windows``, in hundreds so that few sequences are cached."""
    return np.clip(DENSITY * windows.area, FEWEST_SAMPLES, MOST_SAMPLES).astype(np.intp) // 100 * 100


def read(grey: Grey, windows: Windows, count: int) -> Samples:
    """The grey levels at ``count`` points, an even number, of each of ``windows``."""
    area, sides = np.maximum(windows.area, 1.0), np.linalg.norm(windows.axes, axis=1)
    # A point BAND_PX away from the line s = 0 has |s| = BAND_PX ÷ the height of the window over its axis t.
    band = np.minimum(1.0, BAND_PX * 4.0 * sides[:, ::-1] / area[:, None])
    share = np.clip(band * (DENSITY * area / count - 1.0)[:, None], 0.0, MAX_BAND_SHARE)
    s, t = _places(count, band, share)
    places = windows.at(s, t).transpose(0, 2, 1)
    u, v = places[..., 0], places[..., 1]
    inside = np.asarray((u >= 0) & (v >= 0) & (u <= grey.shape[1] - 1) & (v <= grey.shape[0] - 1))
    along = count / area * (1.0 - share.sum(axis=1) + (share / band).mean(axis=1))
    return Samples(s, t, sample(grey, places), inside, np.maximum(1.0, along / INDEPENDENT_DENSITY))


def _places(count: int, band: Floats, share: Floats) -> tuple[Floats, Floats]:
    """s and t (n, count): ``share`` (n, 2) in the ``band`` (n, 2) about s = 0 and t = 0, the rest everywhere."""
    s, t = _sequence(count)
    part = (np.arange(count) % (count // 2) + 0.5) / (count // 2)
    by_s = part < share[:, :1]
    by_t = ~by_s & (part < share.sum(axis=1, keepdims=True))
    return np.where(by_s, s * band[:, :1], s), np.where(by_t, t * band[:, 1:], t)


@cache
def _sequence(count: int) -> Floats:
    """Points (s, t), (2, count), that fill a window evenly and symmetrically, no two on one line.

    On a regular grid all samples along an edge parallel to the pixel rows would have the same subpixel position, and so
    the same error of interpolation. (The additive sequence of the plastic number; Roberts, 2018.)
    """
    plastic = 1.324717957244746
    steps = np.arange(1, count // 2 + 1)
    half = np.stack([steps / plastic % 1.0, steps / plastic**2 % 1.0]) * 2 - 1
    return np.concatenate([half, -half], axis=1)
