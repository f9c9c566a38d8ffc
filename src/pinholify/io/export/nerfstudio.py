"""nerfstudio's transforms.json (https://docs.nerf.studio/quickstart/data_conventions.html).

Its rays go through pixel centres at half-integers, so the principal point moves by half a pixel as for COLMAP. The
list of frames is empty: the poses of photographs are what structure from motion is to find.
"""

from __future__ import annotations

import json
from pathlib import Path

from pinholify.io.export.base import NO_MAPS, Format, PinholeExport
from pinholify.io.files import writing_text

HALF = 0.5  # px from the corner of the top-left pixel to its centre


def write(export: PinholeExport, path: Path) -> None:
    """Model OPENCV with zero distortion, shared by all frames."""
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


FORMAT = Format((".json",), write, f"{NO_MAPS}; its list of frames is empty, to be filled with the photographs' poses")
