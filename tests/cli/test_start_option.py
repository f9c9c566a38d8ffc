"""``pinholify calibrate --start``: begin with a camera that is roughly this one."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pinholify.io.camera_file import read_camera
from pinholify.io.corner_tables import write_corner_table
from small_camera import corner_set

JOINT = ("--board", "9x6", "--image-size", "640x480", "--no-opencv", "--no-heldout")

THEIRS = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {focal}, 0., 320., 0., 460., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0., 0., 0., 0., 0. ]
"""


@pytest.fixture
def theirs(run, tmp_path):
    """Imports a camera of OpenCV's without distortion, its focal length a tenth off; a reflection where asked for."""

    def imported(focal=460.0):
        source, target = tmp_path / "theirs.yaml", tmp_path / "theirs.npz"
        source.write_text(THEIRS.format(focal=focal))
        assert run("import", source, "-o", target).status == 0
        return target

    return imported


def test_an_imported_camera_a_tenth_off_ends_at_the_same_camera(run, table, theirs):
    assert run("calibrate", "--corners", table, *JOINT, "-o", "without.npz").status == 0
    led = run("calibrate", "--corners", table, *JOINT, "--start", theirs(), "--json", "-o", "led.npz")
    assert (led.status, led.err) == (0, "")
    assert json.loads(led.out)["details"]["start_fits"] is True
    uv = np.array([[100.0, 80.0], [320.0, 240.0], [560.0, 400.0]])
    rays = [read_camera(name).camera.to_rays(uv).directions for name in ("without.npz", "led.npz")]
    np.testing.assert_allclose(*rays, atol=1e-5)


def test_a_camera_of_our_own(run, table, camera):
    led = run("calibrate", "--corners", table, *JOINT, "--start", camera, "--json", "-o", "led.npz")
    assert json.loads(led.out)["details"]["start_fits"] is True
    assert json.loads(led.out)["method"] == "joint"


def test_few_boards_are_calibrated_jointly_with_a_start(run, poses, camera):
    write_corner_table("few.vnl", corner_set(poses[:3]))
    led = run("calibrate", "--corners", "few.vnl", *JOINT, "--start", camera, "--json", "-o", "led.npz")
    assert json.loads(led.out)["method"] == "joint"


def test_a_start_of_another_mode_is_refused(run, refused, table, camera):
    assert run("mode", camera, "--size", "320x240", "-o", "half.npz").status == 0
    sentence = refused("calibrate", "--corners", table, *JOINT, "--start", "half.npz", "-o", "led.npz")
    assert "a camera for images of 320x240, but these images are 640x480" in sentence
    assert "'pinholify mode'" in sentence


def test_a_start_is_read_before_photographs_are_looked_at(refused, photographs, tmp_path):
    (tmp_path / "no.npz").write_text("nothing")
    assert "no.npz" in refused("calibrate", photographs, "--board", "9x6", "--start", "no.npz", "-o", "led.npz")


def test_the_start_is_not_replaced(refused, table, camera):
    assert "is one of the inputs" in refused("calibrate", "--corners", table, *JOINT, "--start", camera, "-o", camera)


@pytest.mark.parametrize("words", [("--method", "one-image"), ("--trend", "lens:1")])
def test_the_papers_method_takes_no_start(run, table, camera, words):
    result = run("calibrate", "--corners", table, *JOINT, *words, "--start", camera, "-o", "led.npz")
    assert result.status == 2
    assert "omit it, or choose --method joint" in result.err


def test_what_does_not_explain_the_corners_is_left_aside_and_named(run, table, theirs, monkeypatch):
    """A reflection of which the file does not say that it is one."""
    start = theirs(-460.0)
    reflected = read_camera(start)
    unsaid = replace(reflected, camera=replace(reflected.camera, mirrored=False))
    assert reflected.camera.mirrored
    monkeypatch.setattr("pinholify.io.camera_file.read_camera", lambda _: unsaid)
    result = run("calibrate", "--corners", table, *JOINT, "--start", start, "-o", "led.npz")
    assert result.status == 0
    assert result.err == (
        f"'{start}' was not used as a start because it does not explain the corners: is it this camera and mode?\n"
    )
