"""Maps for ffmpeg's remap filter: OUT-x.pgm and OUT-y.pgm, 16 bits per pixel.

The filter looks up whole pixels, so the maps are rounded. Entries that are not valid point outside any image and get
the filter's fill colour. ::

    ffmpeg -i in.mp4 -i OUT-x.pgm -i OUT-y.pgm -lavfi remap out.mp4
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pinholify.errors import OutputError
from pinholify.io.export.base import Format, PinholeExport, commented, sibling
from pinholify.io.files import atomic_path

MAX_VALUE = 65535
"""The largest 16-bit value, which marks pixels outside."""


def write(export: PinholeExport, path: Path) -> None:
    """Write both maps; raises OutputError if the original image is too large for 16 bits."""
    if max(export.camera.image_size) > MAX_VALUE:
        width, height = export.camera.image_size
        raise OutputError(
            f"the images are {width}x{height} px and 16-bit maps reach only {MAX_VALUE} px; choose another format"
        )
    for coordinate, target in zip(rounded_maps(export), files(path), strict=True):
        with atomic_path(target) as temporary:
            temporary.write_bytes(_pgm(coordinate, export.statement))


def files(path: Path) -> tuple[Path, Path]:
    """The two files that are written for ``path``."""
    return sibling(path, "-x"), sibling(path, "-y")


def rounded_maps(export: PinholeExport) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Whole columns and rows of the original image, each (h, w), for every pixel of the view."""
    uv = np.rint(export.rectification.uv)
    inside = (uv >= 0).all(axis=2) & (uv < export.camera.image_size).all(axis=2) & export.rectification.valid
    whole = np.where(inside[:, :, None], uv, MAX_VALUE).astype(np.uint16)
    return whole[:, :, 0], whole[:, :, 1]


def _pgm(values: NDArray[np.uint16], statement: tuple[str, ...]) -> bytes:
    """A binary PGM (netpbm's P5); samples have the most significant byte first."""
    height, width = values.shape
    header = f"P5\n{commented(statement)}{width} {height}\n{MAX_VALUE}\n"
    return header.encode("ascii") + values.astype(">u2").tobytes()


FORMAT = Format((".pgm",), write, "the filter uses whole pixels, so its images are off by up to half a pixel", files)
