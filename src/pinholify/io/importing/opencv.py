"""OpenCV's FileStorage, YAML or XML, with the key names of its own samples and some other common ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pinholify.arrays import Floats
from pinholify.io.importing import projections
from pinholify.io.importing.base import MATRIX_NAMES, Foreign, ForeignCamera, Projection

DISTORTION_NAMES = (
    "distortion_coefficients",
    "Distortion_Coefficients",
    "dist_coeffs",
    "dist_coeff",
    "distCoeffs",
    "distortion",
    "D",
)
BROWN = (0, 4, 5, 8, 12, 14)
"""Possible numbers of coefficients of ``cv2.calibrateCamera``."""
FISHEYE = 4


def cameras(foreign: Foreign) -> Mapping[str, ForeignCamera]:
    """The one camera of the file."""
    tree = foreign.tree
    focal, centre = core_of(foreign, _first(tree, MATRIX_NAMES))
    distortion = coefficients(foreign, _first(tree, DISTORTION_NAMES))
    model, project = _model(foreign, np.concatenate([focal, centre]), distortion)
    return {"camera": ForeignCamera(foreign.name, "OpenCV", model, project, focal, centre, foreign.size(foreign.sides))}


def core_of(foreign: Foreign, matrix: Any) -> tuple[Floats, Floats]:
    """(fx, fy) and (cx, cy) of a matrix K as FileStorage and ROS store it."""
    k = foreign.numbers(_data(foreign, matrix), "matrix entries", 9).reshape(3, 3)
    if not (k[0, 0] and k[1, 1]) or np.abs(k[[1, 2, 2, 2], [0, 0, 1, 2]] - [0, 0, 0, 1]).max() > 1e-9 or k[0, 1]:
        raise foreign.refused("its matrix is not that of a camera without skew")
    return k[[0, 1], [0, 1]], k[:2, 2]


def coefficients(foreign: Foreign, value: Any) -> Floats:
    """Distortion coefficients (n,) as FileStorage and ROS store them."""
    return foreign.numbers(_data(foreign, value), "distortion coefficients")


def _data(foreign: Foreign, value: Any) -> Any:
    """The data of a matrix, after a check of its size; anything but a matrix is returned unchanged."""
    if not isinstance(value, dict):
        return value
    data, sides = value.get("data"), (value.get("rows"), value.get("cols"))
    if isinstance(data, list) and None not in sides:
        rows, columns = foreign.numbers(sides, "rows and columns")
        if rows * columns != np.size(data):
            raise foreign.refused(f"a matrix of {rows:g}x{columns:g} has {np.size(data)} numbers")
    return data


def _first(tree: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    return next((tree[name] for name in names if name in tree), None)


def _model(foreign: Foreign, core: Floats, distortion: Floats) -> tuple[str, Projection]:
    fisheye = foreign.fisheye
    if fisheye is None and "fisheye_model" in foreign.tree:
        fisheye = bool(foreign.tree["fisheye_model"])
    if fisheye is None and len(distortion) == FISHEYE and np.any(distortion):
        raise foreign.refused(
            "its 4 coefficients may be those of cv2.calibrateCamera or of cv2.fisheye.calibrate",
            "specify whether they are fisheye coefficients",
        )
    if fisheye:
        return "fisheye", projections.fisheye(core, foreign.numbers(distortion, "fisheye coefficients", FISHEYE))
    count = len(foreign.numbers(distortion, "distortion coefficients", *BROWN))
    return f"{count} coefficients", projections.brown(core, distortion)
