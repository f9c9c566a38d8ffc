"""Smooth surfaces over a board's corners, without a length scale: the functions of a cubic spline.

The kernel is r³ with unpenalised planes: the limit of a Matérn 3/2 process of infinite length scale (Duchon's splines;
Wahba 1990, chapter 2). There is no length scale to choose, only the size of the surface.
"""

from __future__ import annotations

import numpy as np

from pinholify.arrays import Floats

MAX_KNOTS = 400  # of more corners, as many at random carry the surface
MAX_FUNCTIONS = 60  # those left out have a five-hundredth of the surface's variance


def surface_functions(places: Floats) -> Floats:
    """Functions (n, m) at ``places`` (n, 2) whose sum with independent standard normal weights is a smooth surface.

    The surface has no component in any plane, and its expected mean square over the places is one. Fewer than four
    places give no function.
    """
    knots = places[np.random.default_rng(0).permutation(len(places))[:MAX_KNOTS]] if len(places) > MAX_KNOTS else places
    leading = max(0, min(MAX_FUNCTIONS, len(knots) - 3))
    cubes = _without_planes(knots, np.linalg.norm(knots[:, None] - knots, axis=2) ** 3)
    values, vectors = np.linalg.eigh(_without_planes(knots, cubes.T))
    functions = vectors[:, ::-1][:, :leading] * np.sqrt(np.maximum(values[::-1][:leading], 0.0))
    if len(knots) < len(places):
        from scipy.interpolate import RBFInterpolator  # slow to load, and few boards have so many corners

        functions = _without_planes(places, RBFInterpolator(knots, functions, kernel="cubic", degree=1)(places))
    return np.asarray(functions / np.sqrt((functions**2).sum() / len(places))) if leading else functions


def _without_planes(places: Floats, values: Floats) -> Floats:
    """``values`` (n, m) at ``places`` (n, 2) less their best planes."""
    planes = np.linalg.qr(np.column_stack([np.ones(len(places)), places]))[0]
    return values - planes @ (planes.T @ values)
