"""From the pictures on a simulated screen to a camera, through the command line."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.cli import main
from pinholify.io.camera_file import read_camera
from pinholify.io.images import read_image, write_image
from pinholify.simulation.views import virtual_camera
from screen_scene import LENS, SCREEN, SEQUENCE, captures, screen_poses

POSES = screen_poses(5)
BOARD = ("--board", "gray:320x192:16", "--image-size", "320x240")


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A folder with the patterns and the captures of five poses."""
    folder = tmp_path_factory.mktemp("studio")
    make = ["gray-code", "make", "--screen", "320x192", "--pixel", "0.25mm", "-o", str(folder / "patterns")]
    assert main(make) == 0
    for k, pose in enumerate(POSES):
        (folder / f"pose{k}").mkdir()
        for file, image in zip(SEQUENCE.files, captures(pose, seed=k), strict=True):
            write_image(folder / f"pose{k}" / file, image)
    return folder


@pytest.fixture(scope="module")
def table(studio):
    poses = [str(studio / f"pose{k}") for k in range(len(POSES))]
    assert main(["gray-code", "decode", *poses, "--patterns", str(studio / "patterns"), "-o", str(studio / "c.csv"),
                 "--maps", str(studio / "maps")]) == 0
    return studio / "c.csv"


def test_the_pictures_written_are_those_of_the_sequence(studio):
    for file, pattern in zip(SEQUENCE.files, SEQUENCE.patterns, strict=True):
        np.testing.assert_array_equal(read_image(studio / "patterns" / file), SEQUENCE.picture(pattern))


@pytest.mark.parametrize(("method", "trend", "limit"), [("one-image", "lens:3", 0.06), ("joint", "plane", 0.03)])
def test_a_camera_within_truth(table, tmp_path, method, trend, limit):
    """The limit is the rays' RMS error over the reference screen, best rotation removed, in px."""
    path = tmp_path / "camera.npz"
    options = ["--method", method, "--trend", trend, "--reference", "pose0", "--no-opencv", "--no-heldout"]
    assert main(["calibrate", "--corners", str(table), *BOARD, *options, "--square", "4mm", "-o", str(path)]) == 0
    calibration = read_camera(path)
    camera, truth = calibration.camera, virtual_camera(POSES[0])
    k = camera.intrinsics
    np.testing.assert_allclose([k.f, k.uc, k.vc], truth, rtol=2e-3)
    pixels = calibration.corner_set.views[0].uv[::7]
    found, true = camera.to_rays(pixels).directions, LENS.unproject(pixels).directions
    turn = Rotation.align_vectors(true, found)[0]
    assert 210 * np.sqrt(((turn.apply(found) - true) ** 2).sum(axis=1).mean()) < limit


def test_maps_say_what_every_pixel_sees(studio, table):
    with np.load(studio / "maps" / "pose1.npz") as file:
        x, y = file["x"], file["y"]
    known = np.isfinite(x)
    assert known.mean() > 0.1
    np.testing.assert_array_equal(known, np.isfinite(y))
    v, u = np.nonzero(known)
    rays = LENS.unproject(np.column_stack([u, v]).astype(float)).directions
    normal = POSES[1].rotation[:, 2]
    points = rays * ((POSES[1].translation @ normal) / (rays @ normal))[:, None]
    place = ((points - POSES[1].translation) @ POSES[1].rotation[:, :2] + 0.5) * SCREEN.spacing - 0.5
    error = np.linalg.norm(np.column_stack([x[known], y[known]]) - place, axis=1)
    assert np.median(error) < 0.2


def test_json_and_corner_tables(studio, capsys):
    out = studio / "c.vnl"
    arguments = ["gray-code", "decode", str(studio / "pose1"), "--patterns", str(studio / "patterns"), "-o", str(out)]
    assert main([*arguments, "--json", "--spacing", "32"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["board"] == "gray:320x192:32"
    assert told["images"][0]["corners"] > 40
    assert told["std_px"] < 0.1
    assert out.read_text().startswith("# filename x y weight")


def test_what_stands_there_is_not_replaced(studio, tmp_path, capsys):
    assert main(["gray-code", "make", "--screen", "320x192", "-o", str(studio / "patterns")]) == 1
    assert "not empty; choose another folder, or say --force" in capsys.readouterr().err
    (tmp_path / "c.csv").write_text("mine")
    arguments = ["gray-code", "decode", str(studio / "pose1"), "--patterns", str(studio / "patterns")]
    assert main([*arguments, "-o", str(tmp_path / "c.csv")]) == 1
    assert "already there" in capsys.readouterr().err
    assert (tmp_path / "c.csv").read_text() == "mine"


def test_a_missing_folder_is_one_sentence(studio, tmp_path, capsys):
    arguments = ["gray-code", "decode", str(tmp_path / "none"), "--patterns", str(studio / "patterns")]
    assert main([*arguments, "-o", str(tmp_path / "c.csv")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "is not a folder; give a folder with the captures" in error


def test_photographs_of_a_screen_are_no_photographs_of_corners(studio, capsys):
    files = [str(studio / "pose1" / SEQUENCE.files[0])]
    assert main(["detect", *files, "--board", "gray:320x192"]) == 1
    assert "pinholify gray-code decode" in capsys.readouterr().err
