"""Kalibr's camchain YAML (https://github.com/ethz-asl/kalibr/wiki/yaml-formats), with the same pixel convention."""

from __future__ import annotations

from pathlib import Path

from pinholify.io.export.base import NO_MAPS, Format, PinholeExport, commented
from pinholify.io.files import writing_text


def write(export: PinholeExport, path: Path) -> None:
    """Write cam0: model pinhole [fu, fv, pu, pv], distortion radtan with four zeros."""
    width, height = export.view.size
    lines = (
        "cam0:",
        "  camera_model: pinhole",
        f"  intrinsics: [{', '.join(map(repr, export.intrinsics))}]",
        "  distortion_model: radtan",
        "  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]",
        f"  resolution: [{width}, {height}]",
        "  rostopic: /cam0/image_rect",
        "  cam_overlaps: []",
    )
    with writing_text(path) as stream:
        stream.write(commented(export.statement) + "\n".join(lines) + "\n")


FORMAT = Format((".yaml", ".yml"), write, NO_MAPS)
