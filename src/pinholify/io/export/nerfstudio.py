"""nerfstudio's transforms.json (https://docs.nerf.studio/quickstart/data_conventions.html).

Pixel centres are at half-integers, so the principal point moves by half a pixel, as for COLMAP. The list of frames is
empty: finding the poses of the photographs is the task of structure from motion.
"""

from __future__ import annotations

import json
from pathlib import Path

from pinholify.io.export.base import NO_MAPS, Format, PinholeExport
from pinholify.io.files import writing_text

HALF = 0.5  # px from the corner of the top-left pixel to its centre


def write(export: PinholeExport, path: Path) -> None:
    """Write model OPENCV with zero distortion, shared by all frames."""
    fx, fy, cx, cy = export.intrinsics
    width, height = export.view.size
    data = {
        "comment": list(export.statement),
        "camera_model": "OPENCV",
        "w": width,
        "h": height,
        "fl_x": fx,
        "fl_y": fy,
        "cx": cx + HALF,
        "cy": cy + HALF,
        **dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2"), 0.0),
        "frames": [],
    }
    with writing_text(path) as stream:
        json.dump(data, stream, indent=2)
        stream.write("\n")


FORMAT = Format((".json",), write, f"{NO_MAPS}; its list of frames is empty: add the photographs and their poses")
