"""Maps for ffmpeg's remap filter: OUT-x.pgm and OUT-y.pgm, 16 bits a pixel.

The filter looks up whole pixels, so maps are rounded; what is not valid points outside every image and becomes the
filter's fill colour. ::

    ffmpeg -i in.mp4 -i OUT-x.pgm -i OUT-y.pgm -lavfi remap out.mp4
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pinholify.errors import OutputError
from pinholify.io.export.base import Format, PinholeExport, beside, commented
from pinholify.io.files import atomic_path

LARGEST = 65535
"""The largest value of 16 bits, and so what stands for a pixel outside."""


def write(export: PinholeExport, path: Path) -> None:
    """Both maps; raises OutputError where the original is too large for 16 bits."""
    if max(export.camera.image_size) > LARGEST:
        width, height = export.camera.image_size
        raise OutputError(
            f"the images are {width}x{height} where 16-bit maps reach {LARGEST} px; choose another format"
        )
    for coordinate, target in zip(rounded_maps(export), files(path), strict=True):
        with atomic_path(target) as temporary:
            temporary.write_bytes(_pgm(coordinate, export.statement))


def files(path: Path) -> tuple[Path, Path]:
    """The two files that are written when the user says ``path``."""
    return beside(path, "-x"), beside(path, "-y")


def rounded_maps(export: PinholeExport) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Whole columns and rows of the original image for every pixel of the view, (h, w) each."""
    uv = np.rint(export.rectification.uv)
    inside = (uv >= 0).all(axis=2) & (uv < export.camera.image_size).all(axis=2) & export.rectification.valid
    whole = np.where(inside[:, :, None], uv, LARGEST).astype(np.uint16)
    return whole[:, :, 0], whole[:, :, 1]


def _pgm(values: NDArray[np.uint16], statement: tuple[str, ...]) -> bytes:
    """A binary PGM (netpbm's P5), its samples most significant byte first."""
    height, width = values.shape
    header = f"P5\n{commented(statement)}{width} {height}\n{LARGEST}\n"
    return header.encode("ascii") + values.astype(">u2").tobytes()


FORMAT = Format((".pgm",), write, "the filter takes whole pixels: its images are up to half a pixel off", files)
