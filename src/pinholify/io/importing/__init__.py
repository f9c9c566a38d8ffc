"""Imports: cameras that other programs calibrated become ours, so that every command works with them.

A program is a module of this package with a function ``cameras`` that reads its file and one line in :data:`PROGRAMS`.
Files are not trusted: they are read as data, never run, and what is not understood is refused.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

from pinholify.errors import CameraFileError

if TYPE_CHECKING:
    from pinholify.io.importing.base import Foreign, ForeignCamera

PROGRAMS = {
    "mrcal": ".cameramodel",
    "kalibr": "camchain YAML",
    "ros": "camera_info YAML",
    "opencv": "FileStorage, YAML or XML",
}
"""Every program by its name, with what is read of it."""

Reader: TypeAlias = "Callable[[Foreign], Mapping[str, ForeignCamera]]"


def read_foreign(
    path: str | os.PathLike[str],
    *,
    program: str | None = None,
    camera: str | None = None,
    image_size: tuple[int, int] | None = None,
    fisheye: bool | None = None,
) -> ForeignCamera:
    """The camera that another program wrote to ``path``.

    ``program`` is one of :data:`PROGRAMS`, recognised by the content where it is None. ``camera`` names one of several
    in the file. ``image_size`` (width, height) px is for files that do not tell it, ``fisheye`` for those that do not
    tell which of OpenCV's two models of four coefficients they mean. Raises CameraFileError with what is missing or
    not understood.
    """
    from pinholify.io.importing.base import foreign_file

    foreign = foreign_file(path, image_size=image_size, fisheye=fisheye)
    found = program or foreign.program
    reader: Reader = importlib.import_module(f"pinholify.io.importing.{found}").cameras
    cameras = reader(foreign)
    if camera is None and len(cameras) > 1:
        raise CameraFileError(
            f"'{foreign.name}' holds {len(cameras)} cameras; choose one of {', '.join(cameras)} with --camera"
        )
    chosen = next(iter(cameras)) if camera is None else camera
    if chosen not in cameras:
        raise CameraFileError(f"'{foreign.name}' holds no camera '{chosen}'; it holds: {', '.join(cameras)}")
    return cameras[chosen]
