"""OpenCV's FileStorage, YAML or XML by the ending: OUT with K, and OUT-maps with the maps for ``cv2.remap``.

The keys of OUT are those of OpenCV's own calibration samples. Maps are stored as base64, because a 4K view would take
150 MB of digits.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pinholify.io.export.base import Format, PinholeExport, sibling
from pinholify.io.files import atomic_path


def write(export: PinholeExport, path: Path) -> None:
    """Write K and zero distortion to ``path``, and the maps to a file next to it."""
    width, height = export.view.size
    model = {
        "image_width": width,
        "image_height": height,
        "camera_matrix": np.array(export.view.matrix),
        "distortion_coefficients": np.zeros((1, 5)),
        "view": export.options.name,
        "rotation": np.array(export.view.rotation),
        "statement": "\n".join(export.statement),
    }
    map_x, map_y = export.maps
    _write_storage(path, model)
    _write_storage(files(path)[1], {"map_x": map_x, "map_y": map_y}, base64=True)


def files(path: Path) -> tuple[Path, Path]:
    """The two files that are written for ``path``."""
    return path, sibling(path, "-maps")


def _write_storage(path: Path, entries: dict[str, object], *, base64: bool = False) -> None:
    import cv2

    # In memory first: on a full disk FileStorage reports nothing and leaves half a file.
    mode = cv2.FILE_STORAGE_WRITE_BASE64 if base64 else cv2.FILE_STORAGE_WRITE
    storage = cv2.FileStorage(path.suffix.lower(), mode | cv2.FILE_STORAGE_MEMORY)
    for name, value in entries.items():
        storage.write(name, value)
    with atomic_path(path) as temporary:
        temporary.write_text(storage.releaseAndGetString(), encoding="utf-8")


FORMAT = Format((".yaml", ".yml", ".xml"), write, files=files)
