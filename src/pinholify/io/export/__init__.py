"""Exports: a calibrated camera, or an ideal pinhole view of it, written as another program's calibration file.

A format is a module of this package that defines a :class:`pinholify.io.export.base.Format` called ``FORMAT``, and one
line in :data:`FORMATS`. Modules are imported only when their format is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from pinholify.errors import InputError

if TYPE_CHECKING:
    from pinholify.io.export.base import Format

FORMATS = {
    "colmap": "COLMAP cameras.txt, PINHOLE",
    "colmap-simple": "COLMAP cameras.txt, SIMPLE_PINHOLE",
    "ffmpeg": "a pair of 16-bit PGM maps for ffmpeg's remap filter",
    "kalibr": "Kalibr camchain YAML",
    "matlab": "MATLAB .mat: intrinsics and maps for interp2",
    "mrcal": "mrcal .cameramodel, LENSMODEL_PINHOLE",
    "mrcal-splined": "mrcal .cameramodel of the camera itself, LENSMODEL_SPLINED_STEREOGRAPHIC",
    "nerfstudio": "nerfstudio transforms.json",
    "npy": "NumPy array of the maps only",
    "opencv": "OpenCV FileStorage, YAML or XML, and maps for cv2.remap",
    "ros": "ROS camera_info YAML",
}
"""Name of each format → its description."""


def format_named(name: str) -> Format:
    """The format called ``name``; raises InputError if it is unknown."""
    if name not in FORMATS:
        raise InputError(f"unknown export format '{name}': choose one of {', '.join(FORMATS)}")
    module = importlib.import_module(f"pinholify.io.export.{name.replace('-', '_')}")
    found: Format = module.FORMAT
    return found
