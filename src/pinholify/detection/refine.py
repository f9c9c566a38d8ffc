"""The last step of detection: a grown lattice's corners are fitted at full resolution, weighted and filtered."""

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
"""Half window, as a fraction of the spacing, of the quadratic fit that brings corners within reach of the last fit."""

WINDOW = 0.33
"""Half window of the last fit, likewise: a third of a square of each line in each direction."""

MAX_WINDOW_PX = 60.0
"""Largest half window."""

MOST_BEND_PX, NARROW_WINDOW_PX = 0.25, 20.0
"""Half windows end where the board's lines deviate from straight by the first, but not below the second.

Lines that bend so much have a notable third derivative too, which the fit does not model.
"""

SPOILT_RATIO = 1.4
"""A window whose misfit exceeds the median by this factor contains more than its corner."""

STD_FLOOR_PX = 0.03
"""Errors that the fit cannot see: print, pixel response, the model. They limit a corner's weight."""


def _indices(index: Ints) -> Floats:
    """The positions of corners on a square lattice: their indices."""
    return index.astype(np.float64)


def refine_lattice(grey: Grey, lattice: Lattice, places: Callable[[Ints], Floats] = _indices) -> Lattice:
    """``lattice`` with fitted positions and weights, without what is not a corner.

    ``places`` maps indices (n, 2) to positions on the board (n, 2) where corners are unevenly spaced; its unit is the
    square of which the windows are fractions.
    """
    at = places(lattice.index)
    lattice = lattice.moved(settled(grey, lattice.uv, local_frames(at, lattice.uv)[0]))
    crossings = fit_corners(grey, lattice.uv, *local_frames(at, lattice.uv))
    fitted = lattice.moved(crossings.uv, weights(crossings))
    kept = fitted.select(true_corners(fitted, crossings))
    return kept.select(regular(kept, places(kept.index)))


def settled(grey: Grey, uv: Floats, jacobian: Floats) -> Floats:
    """``uv`` (n, 2) px, moved to the nearest saddle where there is one; ``jacobian`` (n, 2, 2) is the lattice's."""
    length = np.linalg.norm(jacobian, axis=1).min(axis=1)
    radius = np.clip(FIRST_WINDOW * length, 2.0, MAX_WINDOW_PX)
    saddles = refine_saddles(grey, uv, jacobian * (radius / length)[:, None, None])
    return np.where(saddles.sound[:, None], saddles.uv, uv)


def fit_corners(grey: Grey, uv: Floats, jacobian: Floats, second: Floats) -> Crossings:
    """The edges that cross near ``uv`` (n, 2) px, along lines with the derivatives of :func:`local_frames`."""
    return _fit(grey, _windows(uv, jacobian, second, WINDOW))


def weights(crossings: Crossings) -> Floats:
    """Weights (n,): STD_FLOOR_PX / √(STD_FLOOR_PX² + std²)."""
    return _weight(crossings.std)


def _weight(std: Floats) -> Floats:
    return np.asarray(STD_FLOOR_PX / np.hypot(STD_FLOOR_PX, std))


def _windows(uv: Floats, jacobian: Floats, second: Floats, fraction: float) -> Windows:
    length = np.linalg.norm(jacobian, axis=1)
    bends = np.linalg.norm(second[:, :, ::2], axis=1).max(axis=1, keepdims=True) / 2
    straight = np.sqrt(MOST_BEND_PX / np.maximum(bends, 1e-9))
    part = np.minimum(fraction, np.minimum(MAX_WINDOW_PX, np.maximum(straight * length, NARROW_WINDOW_PX)) / length)
    products = np.stack([part[:, 0] ** 2 / 2, part[:, 0] * part[:, 1], part[:, 1] ** 2 / 2], axis=1)
    return Windows(uv, jacobian * part[:, None, :], second * products[:, None, :])


def _fit(grey: Grey, windows: Windows) -> Crossings:
    """Fits of all corners; where a finger or glare spoils a window, half the window is tried instead."""
    wide = fit_crossings(grey, windows)
    misfit = wide.residual / np.abs(wide.strength)
    spoilt = np.flatnonzero(~wide.sound | (misfit > SPOILT_RATIO * np.median(misfit)))
    if not len(spoilt):
        return wide
    narrow = fit_crossings(grey, windows.select(spoilt).scaled(0.5))
    better = narrow.sound & ((narrow.residual < 0.9 * wide.residual[spoilt]) | ~wide.sound[spoilt])
    return wide.replaced(spoilt[better], narrow.select(np.flatnonzero(better)))


def true_corners(lattice: Lattice, crossings: Crossings, usual: Bools | None = None) -> Bools:
    """Which fits (n,) have the colours of their index, a tenth of the median contrast and half of the median weight.

    Smaller windows make a corner less accurate: for this comparison weights are converted to the median window size.
    The medians are those of the corners ``usual`` (n,), by default of all.
    """
    usual = np.ones(len(lattice), dtype=bool) if usual is None else usual
    strength = crossings.strength * signs(lattice.index, lattice.phase)
    clear = strength > 0.1 * np.median(strength[usual])
    weight = _weight(crossings.std * crossings.half / np.median(crossings.half[usual]))
    sure = weight > 0.5 * np.median(weight[usual])
    return np.asarray(crossings.sound & clear & sure & (crossings.residual < 0.5 * strength))
