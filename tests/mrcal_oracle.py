"""mrcal itself as a witness: Debian's package serves the system's Python only, so it runs as another process."""

from __future__ import annotations

import functools
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

CODE = """
import sys, json, numpy as np, mrcal
asked = json.load(sys.stdin)
model = mrcal.cameramodel(asked["path"])
rt = model.extrinsics_rt_fromref()
points = mrcal.transform_point_rt(rt, np.array(asked["points"]))
rays = mrcal.unproject(np.array(asked["pixels"]), *model.intrinsics(), normalize=True)
json.dump([mrcal.project(points, *model.intrinsics()).tolist(), (rays @ mrcal.R_from_r(rt[:3])).tolist()], sys.stdout)
"""


@functools.cache
def _python() -> str | None:
    for python in (sys.executable, "/usr/bin/python3"):
        command = [python, "-c", "import mrcal"]
        if Path(python).exists() and subprocess.run(command, capture_output=True).returncode == 0:
            return python
    return None


def mrcal(path, points, pixels=((0.0, 0.0),)):
    """What mrcal makes of the model at ``path``: pixels of ``points`` (n, 3) of its reference frame, and directions in
    that frame of ``pixels`` (m, 2). Skips where mrcal is not installed.
    """
    python = _python()
    if python is None:
        pytest.skip("mrcal is not installed (Debian: python3-mrcal)")
    asked = {"path": str(path), "points": np.asarray(points).tolist(), "pixels": np.asarray(pixels).tolist()}
    answer = subprocess.run([python, "-c", CODE], input=json.dumps(asked), capture_output=True, text=True, check=True)
    projected, rays = json.loads(answer.stdout)
    return np.array(projected), np.array(rays)
