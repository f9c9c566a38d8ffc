"""The demo: the whole chain on a rendered scene."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pinholify.demo import ABOUT, run_demo, side_by_side
from pinholify.io.camera_file import read_camera
from pinholify.io.images import read_image
from pinholify.simulation.demo import DEMO


@pytest.mark.slow
def test_demo(tmp_path):
    folder = tmp_path / "demo"
    (folder / "photographs").mkdir(parents=True)
    (folder / "photographs" / "mine.jpg").write_text("not of the demo\n")
    steps: list[str] = []
    result = run_demo(folder, step=steps.append)
    assert steps[0].startswith("Rendering 12 photographs")
    assert len(steps) == 5
    about = (folder / ABOUT).read_text(encoding="utf-8")
    for path in folder.iterdir():
        assert path.name == ABOUT or path.name in about
    for name in ("before-after.jpg", "board.jpg", "collinearity.jpg", "street.jpg", "street-straight.png"):
        assert read_image(folder / name).std() > 10
    assert len(list((folder / "photographs").glob("demo-*.jpg"))) == DEMO.views
    numbers = json.loads((folder / "numbers.json").read_text())
    k = read_camera(folder / "camera.npz").camera.intrinsics
    assert [numbers["f"], numbers["uc"], numbers["vc"]] == [k.f, k.uc, k.vc]
    error = np.abs(np.array([k.f, k.uc, k.vc]) - DEMO.truth().virtual_camera).max()
    assert numbers["largest_error_of_f_uc_vc_squares"] == result.intrinsics_error == error
    assert error < 0.01
    assert numbers["heldout_px"] < 0.5
    assert numbers["heldout_px"] < min(v for v in numbers["opencv_heldout_px"].values() if v is not None)


def test_two_pictures_beside_each_other():
    before, after = np.zeros((100, 80), np.uint8), np.full((200, 300, 3), 200, np.uint8)
    both = side_by_side(before, after, "before", "after")
    assert both.shape == (164, 80 + 12 + 150, 3)
    assert (both[64:, :80] == 0).all()
    assert (both[64:, 92:] == 200).all()
