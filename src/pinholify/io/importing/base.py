"""A camera of another program, and the file that contains it."""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from pinholify.arrays import Floats
from pinholify.errors import CameraFileError
from pinholify.io.files import reading_text
from pinholify.io.importing.trees import xml_tree, yaml_tree

MAX_BYTES = 64 << 20
"""Larger files are refused; even files that contain all corners of a calibration are smaller."""

MAX_SIDE_PX = 1 << 20  # px

Projection: TypeAlias = Callable[[Floats], Floats]
"""Directions or points (n, 3) in the camera's frame → pixels (n, 2), nan where there is none."""


@dataclass(frozen=True, slots=True, eq=False)
class ForeignCamera:
    """A camera as another program describes it.

    ``source`` is the file's name, ``program`` the program that wrote it, and ``model`` that program's name of the lens
    model. ``project`` is the projection; ``focal`` (2,) and ``centre`` (2,) are fx, fy and cx, cy in px, with (0, 0) at
    the centre of the top-left pixel. ``image_size`` is (width, height) px.
    """

    source: str
    program: str
    model: str
    project: Projection
    focal: Floats
    centre: Floats
    image_size: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Foreign:
    """A file's content as plain data, and the caller's ``image_size`` and ``fisheye``: see :func:`read_foreign`."""

    name: str
    tree: Mapping[str, Any]
    image_size: tuple[int, int] | None
    fisheye: bool | None

    @property
    def program(self) -> str:
        """The program that wrote the file; raises CameraFileError if it is not recognised."""
        if "lensmodel" in self.tree:
            return "mrcal"
        if any(isinstance(value, dict) and "camera_model" in value for value in self.tree.values()):
            return "kalibr"
        if "distortion_model" in self.tree and "camera_matrix" in self.tree:
            return "ros"
        if any(name in self.tree for name in MATRIX_NAMES):
            return "opencv"
        raise self.refused("it is not a camera of mrcal, OpenCV, Kalibr or ROS")

    def refused(self, why: str, remedy: str = "give a calibration file of these programs") -> CameraFileError:
        """The error that says ``why`` the file cannot be read, and the ``remedy``."""
        return CameraFileError(f"'{self.name}' cannot be imported: {why}; {remedy}")

    def numbers(self, value: Any, what: str, *counts: int) -> Floats:
        """``value`` as finite numbers (n,), n one of ``counts`` if any are given; ``what`` names it in messages."""
        try:
            array = np.array(value, dtype=np.float64).ravel()
        except (TypeError, ValueError):
            wrong = f"it has no {what}" if value is None else f"not all of its {what} are numbers"
            raise self.refused(wrong) from None
        if not np.isfinite(array).all():
            raise self.refused(f"not all of its {what} are finite" if value is not None else f"it has no {what}")
        if counts and len(array) not in counts:
            needed = " or ".join(map(str, counts))
            raise self.refused(f"it has {len(array)} {what} where {needed} are needed")
        return array

    @property
    def sides(self) -> list[Any] | None:
        """Width and height as FileStorage and ROS store them, None if one is missing."""
        sides = [self.tree.get("image_width"), self.tree.get("image_height")]
        return None if None in sides else sides

    def size(self, value: Any) -> tuple[int, int]:
        """The image size in the file or from the caller; raises CameraFileError if both differ or both are missing."""
        found = None if value is None else tuple(int(n) for n in self.numbers(value, "image sides", 2))
        chosen = found or self.image_size
        if chosen is None:
            raise self.refused("it does not contain the size of the images", "give the image size")
        if self.image_size not in (None, chosen):
            raise self.refused(f"it is for images of {chosen[0]}x{chosen[1]}, not of the given size")
        if not 1 <= min(chosen) <= max(chosen) <= MAX_SIDE_PX:
            raise self.refused(f"it is for images of {chosen[0]}x{chosen[1]}")
        return chosen[0], chosen[1]


MATRIX_NAMES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "intrinsic_matrix")
"""Names of the matrix in programs that use OpenCV's FileStorage; the first two are those of its own samples."""


def foreign_file(
    path: str | os.PathLike[str], *, image_size: tuple[int, int] | None = None, fisheye: bool | None = None
) -> Foreign:
    """Read the content of ``path``; raises CameraFileError if it is not one of the supported kinds of file."""
    name = os.fspath(path)
    with reading_text(path, CameraFileError) as stream:
        if Path(path).stat().st_size > MAX_BYTES:
            raise CameraFileError(f"'{name}' is larger than {MAX_BYTES >> 20} MiB and not a camera of another program")
        text = stream.read()
    try:
        tree = _tree(text)
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        tree = None
    if not isinstance(tree, dict):
        raise CameraFileError(
            f"'{name}' is not a camera of another program, or is damaged; give a file of mrcal, OpenCV, Kalibr or ROS"
        )
    return Foreign(name, tree, image_size, fisheye)


def _tree(text: str) -> Any:
    start = "".join(line for line in text.splitlines() if not line.lstrip().startswith("#")).lstrip()
    if start.startswith("{"):
        return ast.literal_eval(text)
    return xml_tree(text) if start.startswith("<") else yaml_tree(text)
