"""The last step of detection: a grown lattice's corners fitted at full size, weighed, and the unfit ones
dropped.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.detection.edges import Crossings, fit_crossings
from pinholify.detection.growth import regular, signs
from pinholify.detection.intensity import Grey
from pinholify.detection.lattice import Lattice
from pinholify.detection.prediction import local_frames
from pinholify.detection.saddle import refine_saddles
from pinholify.detection.windows import Windows

FIRST_WINDOW = 0.15
"""Half window, as a fraction of the spacing, of the quadratic fit that brings corners within reach of the
last fit.
"""

WINDOW = 0.33
"""Half window of the last fit, likewise: the lines of a third of a square each way."""

WIDEST = 60.0
"""Half windows are no wider than this, in px."""

STRAIGHT, NARROW = 0.25, 20.0
"""Nor wider than where the board's lines bend by the first, unless that is narrower than the second, in px: what bends
so much has a third derivative too, which no fit knows.
"""

SPOILT = 1.4
"""A window whose misfit is so many times the usual holds something else beside its corner."""

FLOOR = 0.03
"""px. What no fit sees: print, pixel response, the model. A corner fitted better than this gains nothing by
it.
"""


def _indices(index: Ints) -> Floats:
    """The places of corners that stand on a square lattice."""
    return index.astype(np.float64)


def refine_lattice(grey: Grey, lattice: Lattice, places: Callable[[Ints], Floats] = _indices) -> Lattice:
    """``lattice`` with fitted positions, weights FLOOR / √(FLOOR² + std²), and only corners that are true
    corners.

    ``places`` takes indices (n, 2) to places on the board (n, 2) where corners are unevenly spaced; its unit is the
    square of which the windows are fractions.
    """
    at = places(lattice.index)
    lattice = lattice.moved(settled(grey, lattice.uv, local_frames(at, lattice.uv)[0]))
    crossings = fit_corners(grey, lattice.uv, *local_frames(at, lattice.uv))
    fitted = lattice.moved(crossings.uv, weights(crossings))
    kept = fitted.select(true_corners(fitted, crossings))
    return kept.select(regular(kept, places(kept.index)))


def settled(grey: Grey, uv: Floats, jacobian: Floats) -> Floats:
    """``uv`` (n, 2) px moved to the saddles next to them, for those that have one; ``jacobian`` is that of the lattice.
    """
    length = np.linalg.norm(jacobian, axis=1).min(axis=1)
    radius = np.clip(FIRST_WINDOW * length, 2.0, WIDEST)
    saddles = refine_saddles(grey, uv, jacobian * (radius / length)[:, None, None])
    return np.where(saddles.sound[:, None], saddles.uv, uv)


def fit_corners(grey: Grey, uv: Floats, jacobian: Floats, second: Floats) -> Crossings:
    """The edges that cross at ``uv`` (n, 2) px, along lines with the derivatives of :func:`local_frames`."""
    return _fit(grey, _windows(uv, jacobian, second, WINDOW))


def weights(crossings: Crossings) -> Floats:
    """FLOOR / √(FLOOR² + std²), (n,)."""
    return _weight(crossings.std)


def _weight(std: Floats) -> Floats:
    return np.asarray(FLOOR / np.hypot(FLOOR, std))


def _windows(uv: Floats, jacobian: Floats, second: Floats, fraction: float) -> Windows:
    length = np.linalg.norm(jacobian, axis=1)
    bends = np.linalg.norm(second[:, :, ::2], axis=1).max(axis=1, keepdims=True) / 2
    straight = np.sqrt(STRAIGHT / np.maximum(bends, 1e-9))
    part = np.minimum(fraction, np.minimum(WIDEST, np.maximum(straight * length, NARROW)) / length)
    products = np.stack([part[:, 0] ** 2 / 2, part[:, 0] * part[:, 1], part[:, 1] ** 2 / 2], axis=1)
    return Windows(uv, jacobian * part[:, None, :], second * products[:, None, :])


def _fit(grey: Grey, windows: Windows) -> Crossings:
    """Fits all corners; where a window is spoilt, by a finger or a glare, half the window is tried instead.
    """
    wide = fit_crossings(grey, windows)
    misfit = wide.residual / np.abs(wide.strength)
    spoilt = np.flatnonzero(~wide.sound | (misfit > SPOILT * np.median(misfit)))
    if not len(spoilt):
        return wide
    narrow = fit_crossings(grey, windows.select(spoilt).scaled(0.5))
    better = narrow.sound & ((narrow.residual < 0.9 * wide.residual[spoilt]) | ~wide.sound[spoilt])
    return wide.replaced(spoilt[better], narrow.select(np.flatnonzero(better)))


def true_corners(lattice: Lattice, crossings: Crossings, usual: Bools | None = None) -> Bools:
    """Which fits (n,) have the colours of their index, a tenth of the usual contrast, half of the usual weight.

    Smaller windows leave a corner less well known: it is given the weight that it had if all were of the usual size.
    ``usual`` (n,) are the corners that tell what is usual: all of them by default.
    """
    usual = np.ones(len(lattice), dtype=bool) if usual is None else usual
    strength = crossings.strength * signs(lattice.index, lattice.phase)
    clear = strength > 0.1 * np.median(strength[usual])
    weight = _weight(crossings.std * crossings.half / np.median(crossings.half[usual]))
    sure = weight > 0.5 * np.median(weight[usual])
    return np.asarray(crossings.sound & clear & sure & (crossings.residual < 0.5 * strength))
