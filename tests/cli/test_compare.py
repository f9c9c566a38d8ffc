"""``pinholify compare``: the same camera agrees with itself, another does not."""

import json

import cv2
import numpy as np
import pytest

from pinholify.cli import main
from pinholify.io.camera_file import write_camera
from pinholify.pipeline import calibrate
from synthetic import corner_set as views


@pytest.fixture(scope="module")
def cameras(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cameras")
    for name, squeeze, seed in (("a", 0.1, 0), ("again", 0.1, 1), ("other", 0.11, 2)):
        made = calibrate(views(8, squeeze=squeeze, seed=seed), method="joint", trend="plane:1")
        write_camera(folder / f"{name}.npz", made)
    return folder


def test_two_calibrations_of_one_camera_agree(cameras, capsys):
    assert main(["compare", str(cameras / "a.npz"), str(cameras / "again.npz"), "--json", "--strict"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["agree"]
    assert answer["rms_px"] == pytest.approx(answer["expected_rms_px"], rel=0.8)


def test_a_changed_camera_is_seen_and_drawn(cameras, capsys, tmp_path):
    picture = tmp_path / "difference.png"
    assert main(["compare", str(cameras / "a.npz"), str(cameras / "other.npz"), "-o", str(picture)]) == 0
    assert "the cameras differ" in capsys.readouterr().out
    drawn = cv2.imread(str(picture))
    assert drawn.shape[1] == 1280
    scale = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[None], cv2.COLORMAP_VIRIDIS)[0].astype(int)
    shown = drawn[-56, 230:1010].astype(int)
    np.testing.assert_array_equal(shown[[0, -1]], scale[[0, -1]])
    assert (np.abs(shown[:, None] - scale).sum(axis=2).min(axis=1) == 0).all()
    assert main(["compare", str(cameras / "a.npz"), str(cameras / "other.npz"), "--strict"]) == 1
    assert "differ by" in capsys.readouterr().err
