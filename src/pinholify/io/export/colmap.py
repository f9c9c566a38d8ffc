"""COLMAP's cameras.txt (https://colmap.github.io/cameras.html), read by COLMAP and pycolmap.

COLMAP's origin is the outer corner of the top-left pixel, so the principal point moves by half a pixel.
"""

from __future__ import annotations

from pathlib import Path

from pinholify.io.export.base import NO_MAPS, Format, PinholeExport, commented
from pinholify.io.files import writing_text

HALF = 0.5  # px from the corner of the top-left pixel to its centre
COLUMNS = ("CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",)


def write(export: PinholeExport, path: Path) -> None:
    """Write camera 1, model PINHOLE: fx, fy, cx, cy."""
    fx, fy, cx, cy = export.intrinsics
    write_model(export, path, "PINHOLE", (fx, fy, cx + HALF, cy + HALF))


def write_model(export: PinholeExport, path: Path, model: str, parameters: tuple[float, ...]) -> None:
    """Write camera 1 with the given model and parameters, which follow COLMAP's own convention."""
    width, height = export.view.size
    with writing_text(path) as stream:
        stream.write(commented((*export.statement, *COLUMNS)))
        stream.write(" ".join(["1", model, str(width), str(height), *map(repr, parameters)]) + "\n")


FORMAT = Format((".txt",), write, NO_MAPS)
