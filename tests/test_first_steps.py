"""The first pages of the docs: their Python runs as it stands there, from photographs to a camera and its check."""

from __future__ import annotations

import numpy as np

from pinholify.simulation.views import board_poses, virtual_camera
from small_camera import BOARD, LENS
from test_how_to import run, take


def test_calibrate_then_check(tmp_path, monkeypatch):
    poses = board_poses((LENS,), BOARD, 6, seed=3)
    for name, pose in zip(("a", "b", "c", "d", "new-1", "new-2"), poses, strict=True):
        take(tmp_path / f"{name}.jpg", pose)
    made = run("calibrate.md", tmp_path, monkeypatch)
    k = made["camera"].intrinsics
    np.testing.assert_allclose([k.f, k.uc, k.vc], virtual_camera(poses[0]), atol=0.02)  # squares
    assert made["straight"].shape == (480, 640)
    checked = run("check.md", tmp_path, monkeypatch)
    assert checked["evaluation"].heldout_px < 0.2
