"""COLMAP's cameras.txt with a single focal length; nothing is lost against PINHOLE, because views have fx = fy."""

from __future__ import annotations

from pathlib import Path

from pinholify.io.export.base import NO_MAPS, Format, PinholeExport
from pinholify.io.export.colmap import HALF, write_model


def write(export: PinholeExport, path: Path) -> None:
    """Write camera 1, model SIMPLE_PINHOLE: f, cx, cy."""
    f, _, cx, cy = export.intrinsics
    write_model(export, path, "SIMPLE_PINHOLE", (f, cx + HALF, cy + HALF))


FORMAT = Format((".txt",), write, NO_MAPS)
