"""The maps as one plain NumPy array (height, width, 2) float32: column and row of the original, nan where not valid."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pinholify.io.export.base import Format, PinholeExport
from pinholify.io.files import atomic_path


def write(export: PinholeExport, path: Path) -> None:
    """Read by ``numpy.load``."""
    valid = export.rectification.valid[:, :, None]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.save(file, np.where(valid, export.rectification.uv, np.float32(np.nan)), allow_pickle=False)


FORMAT = Format((".npy",), write, "the array holds the maps alone: K of the view needs another format beside it")
