"""Imports: cameras calibrated by other programs, converted so that every command works with them.

A program is a module of this package with a function ``cameras`` that reads its file, and one line in :data:`PROGRAMS`.
Files are not trusted: they are read as data and never executed, and what is not understood is refused.
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
"""Name of each program → the kind of file that is read."""

Reader: TypeAlias = "Callable[[Foreign], Mapping[str, ForeignCamera]]"


def read_foreign(
    path: str | os.PathLike[str],
    *,
    program: str | None = None,
    camera: str | None = None,
    image_size: tuple[int, int] | None = None,
    fisheye: bool | None = None,
) -> ForeignCamera:
    """Read the camera that another program wrote to ``path``.

    ``program`` is one of :data:`PROGRAMS`; None recognises it by the content. ``camera`` names one of several cameras
    in the file. ``image_size`` (width, height) px is for files that do not contain it, ``fisheye`` for files that do
    not say which of OpenCV's two models with four coefficients they use. Raises CameraFileError, which says what is
    missing or not understood.
    """
    from pinholify.io.importing.base import foreign_file

    foreign = foreign_file(path, image_size=image_size, fisheye=fisheye)
    found = program or foreign.program
    reader: Reader = importlib.import_module(f"pinholify.io.importing.{found}").cameras
    cameras = reader(foreign)
    if camera is None and len(cameras) > 1:
        raise CameraFileError(
            f"'{foreign.name}' holds {len(cameras)} cameras; name the one to import: {' or '.join(cameras)}"
        )
    chosen = next(iter(cameras)) if camera is None else camera
    if chosen not in cameras:
        raise CameraFileError(f"'{foreign.name}' holds no camera '{chosen}'; it holds: {', '.join(cameras)}")
    return cameras[chosen]
