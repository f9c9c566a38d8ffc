"""Real photographs of a GoPro, where they are at hand."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pinholify.io.images import read_image

GOPRO = Path(__file__).parents[2] / "../shared/data/gopro_wide"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not GOPRO.is_dir(), reason="the GoPro's photographs are not here"),
]


def test_gopro_from_one_image(run):
    result = run("calibrate", GOPRO, "--board", "8x6", "--method", "one-image", "-o", "g.npz", "--json")
    assert result.status == 0
    data = json.loads(result.out)
    assert sum(board["corners"] > 0 for board in data["boards"] if board["file"] != "test_image.jpg") >= 35
    assert data["reference"] == "GOPR0064.jpg"
    assert sum(board["used"] for board in data["boards"]) >= 30
    assert data["ce"] < 3.1e-4
    assert data["re_percent"] < 1.07
    assert data["re_refined_percent"] < 0.6
    assert data["heldout_px"] < min(model["heldout_px"] for model in data["opencv"].values())
    done = run("undistort", "g.npz", GOPRO / "test_image.jpg", "-o", "straight")
    assert done.status == 0
    before, after = read_image(GOPRO / "test_image.jpg"), read_image("straight/test_image.jpg")
    assert after.shape == before.shape
    assert np.count_nonzero(after.any(axis=2)) > 0.5 * after[..., 0].size
