"""ROS camera_info YAML, as camera_calibration_parsers and image_pipeline read it (REP 104).

The pixel convention is the same. K and P are those of the view; R is the identity, because images of the view are
already rectified.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pinholify.arrays import Floats
from pinholify.io.export.base import NO_MAPS, Format, PinholeExport, commented, numbers
from pinholify.io.files import writing_text


def write(export: PinholeExport, path: Path) -> None:
    """Write one camera, distortion model plumb_bob with five zeros."""
    width, height = export.view.size
    matrix = export.view.matrix
    parts = [
        commented(export.statement),
        f"image_width: {width}\nimage_height: {height}\ncamera_name: pinholify_{export.options.name}\n",
        _matrix("camera_matrix", matrix),
        "distortion_model: plumb_bob\n",
        _matrix("distortion_coefficients", np.zeros((1, 5))),
        _matrix("rectification_matrix", np.eye(3)),
        _matrix("projection_matrix", np.column_stack([matrix, np.zeros(3)])),
    ]
    with writing_text(path) as stream:
        stream.write("".join(parts))


def _matrix(name: str, values: Floats) -> str:
    rows, columns = values.shape
    return f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: [{numbers(values)}]\n"


FORMAT = Format((".yaml", ".yml"), write, NO_MAPS)
