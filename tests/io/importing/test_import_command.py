"""``pinholify import``: what it writes, says and refuses, and that every command takes its cameras."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from foreign_files import FILES, KALIBR, MRCAL, ROS

from pinholify.cli import main
from pinholify.io.camera_file import is_camera_file, write_camera
from pinholify.io.corner_tables import write_corner_table
from pinholify.simulation.views import board_poses
from small_camera import BOARD, LENS, corner_set
from tilted import tilted_calibration


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Runs the command line in a folder of its own: status, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)

    def command(*words):
        try:
            status = main(list(words))
        except SystemExit as end:
            status = int(end.code or 0)
        return status, *capsys.readouterr()

    return command


def test_it_says_whose_camera_it_was_and_how_well_it_is_repeated(run, tmp_path):
    status, out, err = run("import", "mrcal.cameramodel", "-o", "a.npz")
    assert (status, err) == (0, "")
    first, second, last = out.splitlines()
    assert first == "mrcal LENSMODEL_OPENCV5, 640x480: f 420.75 px"
    assert second.startswith("fit error: ")
    assert last == "wrote a.npz"
    assert is_camera_file(tmp_path / "a.npz")


def test_json(run):
    status, out, _ = run("import", "kalibr.yaml", "--camera", "cam1", "-o", "a.npz", "--json")
    data = json.loads(out)
    assert status == 0
    assert (data["program"], data["model"], data["image_size"]) == ("Kalibr", "ds-none", [640, 480])
    assert data["covered"] == pytest.approx(1.0)
    assert data["fit_rms_px"] < data["fit_largest_px"] < 1e-3


def test_what_a_lens_model_does_not_reach_is_said(run, tmp_path):
    (tmp_path / "fold.yaml").write_text(ROS.replace("-0.21, 0.06", "-0.6, 0.0"))
    status, _, err = run("import", "fold.yaml", "-o", "a.npz")
    assert status == 0
    assert err.startswith("note: ")
    assert err.endswith("% of the image is left out: there the lens model folds, ends or bends too sharply\n")


def test_its_cameras_go_through_every_command(run, tmp_path):
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((480, 640, 3), 90, np.uint8))
    (tmp_path / "points.csv").write_text("u,v\n100,200\n")
    assert run("import", "ros.yaml", "-o", "a.npz")[0] == 0
    assert run("import", "opencv.xml", "-o", "b.npz", "--board", "9x6")[0] == 0
    assert run("undistort", "a.npz", "photo.png", "-o", "straight")[0] == 0
    assert run("map", "a.npz", "--to", "rays", "points.csv", "-o", "rays.csv")[0] == 0
    assert run("export", "a.npz", "--format", "opencv", "-o", "c.yaml")[0] == 0
    status, out, _ = run("compare", "a.npz", "b.npz", "--json")
    assert status == 0
    assert json.loads(out)["rms_px"] < 1e-3


def test_theirs_is_compared_with_ours_and_scored_on_boards(run, tmp_path):
    """A camera of another program of the same lens: as near as ours is good, and scored on corners neither has seen."""
    numbers = [420.0, 420.0, 325.5, 235.5, -0.18, 0.03, 0.0, 0.0]
    model = {"lensmodel": "LENSMODEL_OPENCV4", "intrinsics": numbers, "imagersize": [640, 480]}
    (tmp_path / "true.cameramodel").write_text(repr(model))
    write_camera(tmp_path / "ours.npz", tilted_calibration())
    assert run("import", "true.cameramodel", "-o", "theirs.npz", "--board", "9x6", "--square", "25mm")[0] == 0
    data = json.loads(run("compare", "ours.npz", "theirs.npz", "--json")[1])
    assert data["rms_px"] < 0.5
    assert data["rms_px"] < 4.0 * data["expected_rms_px"]
    poses = board_poses((LENS,), BOARD, 4, seed=5)
    write_corner_table(tmp_path / "boards.vnl", corner_set(poses))
    status, out, _ = run("evaluate", "theirs.npz", "--corners", "boards.vnl", "--no-opencv", "--json")
    assert status == 0
    assert json.loads(out)["unit"] == "px"  # the virtual plane is an ideal image and no board
    assert json.loads(out)["heldout_px"] == pytest.approx(0.05 * np.sqrt(2.0), rel=0.1)
    _, out, _ = run("evaluate", "theirs.npz", "--corners", "boards.vnl")
    assert "imported camera from true.cameramodel: 4 of 4 boards count" in out
    assert "  f            420.00000 px\n" in out
    assert " mm" not in out
    words = " ".join(out.split())  # what it was made of is in no file of theirs
    assert "Good: error 0.07 px on these photographs, which it may have been made from, the file gives no" in words


def test_a_reflection_is_said(run, tmp_path):
    (tmp_path / "mirror.yaml").write_text(ROS.replace("420.0, 0, 325.4", "-420.0, 0, 325.4"))
    status, _, err = run("import", "mirror.yaml", "-o", "a.npz")
    assert status == 0
    assert err == "note: the image is a reflection, because fx = -420 and fy = 421.5: is there a mirror?\n"
    assert json.loads(run("import", "ros.yaml", "-o", "b.npz", "--json")[1])["mirrored"] is False


def test_a_camera_file_is_known_by_its_ending(run, tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((480, 640), np.uint8))
    for words in (("import", "ros.yaml"), ("mode", "ros.npz", "--bin", "2"), ("calibrate", "a.png", "--board", "9x6")):
        status, _, err = run(*words, "-o", "camera.txt")
        assert status == 1
        assert err == "pinholify: 'camera.txt' is not a valid name for a camera file: it must end in .npz\n"
    assert not (tmp_path / "camera.txt").exists()


def test_a_camera_without_a_board_is_not_scored(run):
    assert run("import", "ros.yaml", "-o", "a.npz")[0] == 0
    status, _, err = run("evaluate", "a.npz", "nowhere")
    assert status == 1
    assert err == "pinholify: 'a.npz' was imported without a board; import it again with --board\n"


def test_what_is_there_is_kept_unless_it_is_a_camera_or_forced(run, tmp_path):
    (tmp_path / "mine.npz").write_text("mine")
    status, _, err = run("import", "ros.yaml", "-o", "mine.npz")
    assert (status, err.count("\n")) == (1, 1)
    assert "is already there" in err
    assert (tmp_path / "mine.npz").read_text() == "mine"
    assert run("import", "ros.yaml", "-o", "mine.npz", "--force")[0] == 0
    assert run("import", "mrcal.cameramodel", "-o", "mine.npz")[0] == 0
    status, _, err = run("import", "ros.yaml", "-o", "ros.yaml", "--force")
    assert status == 1
    assert "is one of the inputs" in err
    assert (tmp_path / "ros.yaml").read_text() == ROS


@pytest.mark.parametrize(
    ("name", "text", "words", "sentence"),
    [
        ("a", KALIBR, (), "holds 2 cameras; name the one to import: cam0 or cam1"),
        ("a", "hello", (), "is not a camera of another program"),
        ("a", MRCAL, ("--from", "ros"), "cannot be imported"),
        ("a", MRCAL, ("--image-size", "64x48"), "it is for images of 640x480"),
    ],
)
def test_refusals_are_one_sentence(run, tmp_path, name, text, words, sentence):
    (tmp_path / name).write_text(text)
    status, out, err = run("import", name, "-o", "a.npz", *words)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert sentence in err
    assert not (tmp_path / "a.npz").exists()


def test_the_help_has_an_example(run):
    status, out, _ = run("import", "--help")
    assert status == 0
    assert "pinholify import camera.cameramodel -o theirs.npz" in out
