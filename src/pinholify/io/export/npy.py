"""The maps as one plain NumPy array (height, width, 2) float32: column and row of the original, nan where not valid."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np

from pinholify.io.export.base import Format, PinholeExport
from pinholify.io.files import atomic_path


def write(export: PinholeExport, path: Path) -> None:
    """Read by ``numpy.load``."""
    valid = export.rectification.valid[:, :, None]
    content = BytesIO()  # NumPy, writing to a file itself, does not say why it fails
    np.save(content, np.where(valid, export.rectification.uv, np.float32(np.nan)), allow_pickle=False)
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.getbuffer())


FORMAT = Format((".npy",), write, "the array holds the maps alone: K of the view needs another format beside it")
