"""ROS camera_info YAML, as camera_calibration_parsers writes it; reads K and D, the camera before rectification."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinholify.io.importing import projections
from pinholify.io.importing.base import Foreign, ForeignCamera
from pinholify.io.importing.opencv import coefficients, core_of

BROWN = {"plumb_bob": (0, 4, 5), "rational_polynomial": (8, 12, 14)}
"""Distortion models with OpenCV's coefficients → the possible numbers of coefficients."""
FISHEYE = ("equidistant", "fisheye")


def cameras(foreign: Foreign) -> Mapping[str, ForeignCamera]:
    """The one camera of the file, by its name there."""
    tree, model = foreign.tree, str(foreign.tree.get("distortion_model"))
    focal, centre = core_of(foreign, tree.get("camera_matrix"))
    core, distortion = np.concatenate([focal, centre]), coefficients(foreign, tree.get("distortion_coefficients"))
    if model in BROWN:
        project = projections.brown(core, foreign.numbers(distortion, "distortion coefficients", *BROWN[model]))
    elif model in FISHEYE:
        project = projections.fisheye(core, foreign.numbers(distortion, "distortion coefficients", 4))
    else:
        raise foreign.refused(f"its distortion model {model} is not supported")
    name = str(tree.get("camera_name", "camera"))
    return {name: ForeignCamera(foreign.name, "ROS", model, project, focal, centre, foreign.size(foreign.sides))}
