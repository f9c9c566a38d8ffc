"""mrcal's .cameramodel (https://mrcal.secretsauce.net/cameramodels.html), a Python literal that is never executed.

``extrinsics`` and ``optimization_inputs`` are ignored: they place the camera among others.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from pinholify.arrays import Floats
from pinholify.io.importing import projections
from pinholify.io.importing.base import Foreign, ForeignCamera, Projection
from pinholify.splines import SplineSurface

SPLINED = re.compile(r"SPLINED_STEREOGRAPHIC_order=([23])_Nx=(\d{1,4})_Ny=(\d{1,4})_fov_x_deg=(\d{1,3})")
OPENCV = re.compile(r"OPENCV(4|5|8|12)")
CORE = 4


def cameras(foreign: Foreign) -> Mapping[str, ForeignCamera]:
    """The one camera of the file."""
    model = str(foreign.tree.get("lensmodel"))
    numbers = foreign.numbers(foreign.tree.get("intrinsics"), "intrinsics")
    if len(numbers) < CORE:
        raise foreign.refused(f"it has {len(numbers)} intrinsics where {CORE} or more are needed")
    project = _projection(foreign, model.removeprefix("LENSMODEL_"), numbers[:CORE], numbers[CORE:])
    size = foreign.size(foreign.tree.get("imagersize"))
    return {"camera": ForeignCamera(foreign.name, "mrcal", model, project, numbers[:2], numbers[2:4], size)}


def _projection(foreign: Foreign, model: str, core: Floats, rest: Floats) -> Projection:
    if splined := SPLINED.fullmatch(model):
        return projections.splined_stereographic(core, _surface(foreign, rest, *map(int, splined.groups())))
    if opencv := OPENCV.fullmatch(model):
        return projections.brown(core, foreign.numbers(rest, "distortion coefficients", int(opencv[1])))
    if model == "CAHVOR":
        return projections.cahvor(core, foreign.numbers(rest, "distortion coefficients", 5))
    if model not in PLAIN:
        raise foreign.refused(f"its lens model {model} is not supported")
    foreign.numbers(rest, "distortion coefficients", 0)
    return PLAIN[model](core)


def pinhole(core: Floats) -> Projection:
    """The projection of LENSMODEL_PINHOLE."""
    return projections.brown(core, np.zeros(CORE))


PLAIN = {
    "PINHOLE": pinhole,
    "STEREOGRAPHIC": projections.stereographic,
    "LONLAT": projections.longitude_latitude,
    "LATLON": projections.latitude_longitude,
}
"""Lens models without parameters other than fx, fy, cx, cy."""


def _surface(foreign: Foreign, rest: Floats, order: int, columns: int, rows: int, fov: int) -> SplineSurface:
    if min(columns, rows) <= order or not 0 < fov < 360:
        raise foreign.refused("the numbers of its lens model are not valid")
    control = foreign.numbers(rest, "spline control points", 2 * rows * columns).reshape(rows, columns, 2)
    spacing, origin = knots(order, columns, rows, fov)
    return SplineSurface(origin, np.full(2, spacing), control, order)


def knots(order: int, columns: int, rows: int, fov_x_degrees: int) -> tuple[float, Floats]:
    """Spacing and first position (2,) of the control points, in mrcal's u.

    The grid is centred on the axis and covers the horizontal field of view with a margin of order − 1 intervals in
    total, so that each patch inside has all its control points.
    """
    widest = 2.0 * np.tan(np.deg2rad(fov_x_degrees) / 4.0)
    spacing = float(2.0 * widest / (columns - order))
    return spacing, -spacing * (np.array([columns, rows]) - 1) / 2.0
