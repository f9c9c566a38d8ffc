"""mrcal's .cameramodel (https://mrcal.secretsauce.net/cameramodels.html), a Python literal; same pixel convention.

The reference frame of ``extrinsics`` (rt_cam_ref: a rotation vector, then a translation) is that of the reference
board, so models of several views of one camera have the correct relative orientation.
"""

from __future__ import annotations

from pathlib import Path

from scipy.spatial.transform import Rotation

from pinholify.io.export.base import NO_MAPS, Format, PinholeExport, commented, numbers
from pinholify.io.files import writing_text


def write(export: PinholeExport, path: Path) -> None:
    """Write LENSMODEL_PINHOLE: fx, fy, cx, cy."""
    width, height = export.view.size
    turn = Rotation.from_matrix(export.view.rotation).as_rotvec()
    lines = (
        "{",
        "    'lensmodel': 'LENSMODEL_PINHOLE',",
        f"    'intrinsics': [ {', '.join(map(repr, export.intrinsics))},],",
        f"    'extrinsics': [ {numbers(turn)}, 0.0, 0.0, 0.0,],",
        f"    'imagersize': [ {width}, {height},]",
        "}",
    )
    with writing_text(path) as stream:
        stream.write(commented(export.statement) + "\n".join(lines) + "\n")


FORMAT = Format((".cameramodel",), write, NO_MAPS)
