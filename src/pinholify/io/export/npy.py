"""The maps as one NumPy array (height, width, 2) float32: column and row in the original image, nan if not valid."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np

from pinholify.io.export.base import Format, PinholeExport
from pinholify.io.files import atomic_path


def write(export: PinholeExport, path: Path) -> None:
    """Write the array; read it with ``numpy.load``."""
    valid = export.rectification.valid[:, :, None]
    content = BytesIO()  # writing to a file itself, NumPy does not report why it fails
    np.save(content, np.where(valid, export.rectification.uv, np.float32(np.nan)), allow_pickle=False)
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.getbuffer())


FORMAT = Format((".npy",), write, "the array holds only the maps: export K of the view in another format too")
