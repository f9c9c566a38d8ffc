"""A camera of another program, and the file it comes from."""

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
"""A larger file is refused: the longest that programs write hold a whole calibration's corners and are smaller."""

LARGEST_SIDE = 1 << 20  # px

Projection: TypeAlias = Callable[[Floats], Floats]
"""Directions or points (n, 3) of the camera's frame → pixels (n, 2), nan where it has none."""


@dataclass(frozen=True, slots=True, eq=False)
class ForeignCamera:
    """What another program says of a camera.

    ``source`` is the file's name, ``program`` whose it is, ``model`` that program's own name of the lens model.
    ``project`` is the camera; ``focal`` (2,) and ``centre`` (2,) px are its fx, fy and cx, cy; pixels are ours, (0, 0)
    the centre of the top-left one. ``image_size`` is (width, height) px.
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
    """A file's content as plain data, and what the user says beside it: see :func:`read_foreign`."""

    name: str
    tree: Mapping[str, Any]
    image_size: tuple[int, int] | None
    fisheye: bool | None

    @property
    def program(self) -> str:
        """Which program wrote the file; raises CameraFileError where none is known to write such."""
        if "lensmodel" in self.tree:
            return "mrcal"
        if any(isinstance(value, dict) and "camera_model" in value for value in self.tree.values()):
            return "kalibr"
        if "distortion_model" in self.tree and "camera_matrix" in self.tree:
            return "ros"
        if any(name in self.tree for name in MATRIX_NAMES):
            return "opencv"
        raise self.refused("it is no camera of mrcal, OpenCV, Kalibr or ROS")

    def refused(self, why: str, remedy: str = "give a calibration file of these programs") -> CameraFileError:
        """The error that says ``why`` the file is not read, and the ``remedy``."""
        return CameraFileError(f"'{self.name}' cannot be imported: {why}; {remedy}")

    def numbers(self, value: Any, what: str, *counts: int) -> Floats:
        """``value`` as finite numbers (n,), n one of ``counts`` where any are given; ``what`` names it."""
        try:
            array = np.array(value, dtype=np.float64).ravel()
        except (TypeError, ValueError):
            raise self.refused(f"its {what} are no numbers" if value is not None else f"it has no {what}") from None
        if not np.isfinite(array).all():
            raise self.refused(f"not all of its {what} are finite" if value is not None else f"it has no {what}")
        if counts and len(array) not in counts:
            needed = " or ".join(map(str, counts))
            raise self.refused(f"it has {len(array)} {what} where {needed} are needed")
        return array

    @property
    def sides(self) -> list[Any] | None:
        """Width and height as FileStorage and ROS keep them, None where one is missing."""
        sides = [self.tree.get("image_width"), self.tree.get("image_height")]
        return None if None in sides else sides

    def size(self, value: Any) -> tuple[int, int]:
        """The size of the images that the file tells, or the user; raises CameraFileError where they differ or lack."""
        told = None if value is None else tuple(int(n) for n in self.numbers(value, "image size", 2))
        chosen = told or self.image_size
        if chosen is None:
            raise self.refused("it does not tell the size of the images", "say it with --image-size WxH")
        if self.image_size not in (None, chosen):
            raise self.refused(f"it is of images of {chosen[0]}x{chosen[1]}, not of the size that was given")
        if not 1 <= min(chosen) <= max(chosen) <= LARGEST_SIDE:
            raise self.refused(f"it is of images of {chosen[0]}x{chosen[1]}")
        return chosen[0], chosen[1]


MATRIX_NAMES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "intrinsic_matrix")
"""What programs with OpenCV's FileStorage call the matrix; the first two are those of its own samples."""


def foreign_file(
    path: str | os.PathLike[str], *, image_size: tuple[int, int] | None = None, fisheye: bool | None = None
) -> Foreign:
    """The content of ``path``; raises CameraFileError where it is none of the kinds of file that are read."""
    name = os.fspath(path)
    with reading_text(path, CameraFileError) as stream:
        if Path(path).stat().st_size > MAX_BYTES:
            raise CameraFileError(f"'{name}' is larger than {MAX_BYTES >> 20} MiB and no camera of another program")
        text = stream.read()
    try:
        tree = _tree(text)
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        tree = None
    if not isinstance(tree, dict):
        raise CameraFileError(
            f"'{name}' is no camera of another program, or is damaged; give a file of mrcal, OpenCV, Kalibr or ROS"
        )
    return Foreign(name, tree, image_size, fisheye)


def _tree(text: str) -> Any:
    start = "".join(line for line in text.splitlines() if not line.lstrip().startswith("#")).lstrip()
    if start.startswith("{"):
        return ast.literal_eval(text)
    return xml_tree(text) if start.startswith("<") else yaml_tree(text)
