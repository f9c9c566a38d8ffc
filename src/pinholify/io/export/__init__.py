"""Exports: a calibrated camera, or an ideal pinhole view of it, written as other programs' own calibration files.

A format is a module of this package that holds one :class:`pinholify.io.export.base.Format` called ``FORMAT``, and one
line in :data:`FORMATS`. Modules are loaded when their format is asked for.
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
    "npy": "NumPy array of the maps alone",
    "opencv": "OpenCV FileStorage, YAML or XML, and its maps for remap",
    "ros": "ROS camera_info YAML",
}
"""Every format by its name, with what it is."""


def format_named(name: str) -> Format:
    """The format called ``name``; raises InputError for one that is not known."""
    if name not in FORMATS:
        raise InputError(f"'{name}' is no export format; the formats are: {', '.join(FORMATS)}")
    module = importlib.import_module(f"pinholify.io.export.{name.replace('-', '_')}")
    found: Format = module.FORMAT
    return found
