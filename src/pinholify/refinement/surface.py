"""A smooth surface over a board's corners, of no particular scale: the functions of a cubic spline.

The kernel is r³ beside planes that cost nothing: a Matérn 3/2 process whose length scale has no end (Duchon's splines;
Wahba 1990, chapter 2). So there is no length scale to choose, only how large the surface is.
"""

from __future__ import annotations

import numpy as np

from pinholify.arrays import Floats

KNOTS = 400  # corners beyond which a part of them, scattered over the board, carries the surface
MOST = 60  # functions: those left out, of more, have a five-hundredth of the surface's variance


def surface_functions(places: Floats) -> Floats:
    """Functions (n, m) of independent standard normal weights, at ``places`` (n, 2), without any plane's part.

    The surface of all of them has mean square one over the places. No function where there are too few places.
    """
    knots = places[np.random.default_rng(0).permutation(len(places))[:KNOTS]] if len(places) > KNOTS else places
    leading = max(0, min(MOST, len(knots) - 3))
    cubes = _without_planes(knots, np.linalg.norm(knots[:, None] - knots, axis=2) ** 3)
    values, vectors = np.linalg.eigh(_without_planes(knots, cubes.T))
    functions = vectors[:, ::-1][:, :leading] * np.sqrt(np.maximum(values[::-1][:leading], 0.0))
    if len(knots) < len(places):
        from scipy.interpolate import RBFInterpolator  # slow to load, and few boards have so many corners

        functions = _without_planes(places, RBFInterpolator(knots, functions, kernel="cubic", degree=1)(places))
    return np.asarray(functions / np.sqrt((functions**2).sum() / len(places))) if leading else functions


def _without_planes(places: Floats, values: Floats) -> Floats:
    planes = np.linalg.qr(np.column_stack([np.ones(len(places)), places]))[0]
    return values - planes @ (planes.T @ values)
