"""MATLAB's .mat (version 5): arguments of ``cameraIntrinsics`` and maps for ``interp2``.

MATLAB counts from one: the centre of the top-left pixel is (1, 1), in K and in the maps. Matrices have the textbook
form, with the principal point in the last column.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pinholify.io.export.base import Format, PinholeExport
from pinholify.io.files import atomic_path

ONE = 1.0  # px from our (0, 0) to MATLAB's (1, 1)


def write(export: PinholeExport, path: Path) -> None:
    """Write intrinsics (``ImageSize`` is rows, columns), ``rotation``, ``map_x``, ``map_y`` and ``valid``."""
    from scipy.io import savemat

    fx, fy, cx, cy = export.intrinsics
    width, height = export.view.size
    valid = export.rectification.valid
    uv = np.where(valid[:, :, None], export.rectification.uv + np.float32(ONE), np.float32(np.nan))
    data = {
        "K": np.array([[fx, 0.0, cx + ONE], [0.0, fy, cy + ONE], [0.0, 0.0, 1.0]]),
        "FocalLength": [fx, fy],
        "PrincipalPoint": [cx + ONE, cy + ONE],
        "ImageSize": [float(height), float(width)],
        "RadialDistortion": [0.0, 0.0],
        "TangentialDistortion": [0.0, 0.0],
        "view": export.options.name,
        "rotation": export.view.rotation,
        "statement": "\n".join(export.statement),
        "map_x": uv[:, :, 0],
        "map_y": uv[:, :, 1],
        "valid": valid,
    }
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        savemat(file, data, do_compression=True)


FORMAT = Format((".mat",), write)
