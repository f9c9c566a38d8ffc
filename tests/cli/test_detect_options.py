"""Boards of a size that the photographs tell, and a second look with the camera that took them."""

import json

import numpy as np
import pytest

from pinholify.io.camera_file import read_camera
from pinholify.io.corner_tables import read_corner_table
from pinholify.io.images import read_image, write_image
from small_camera import BOARD, SIZE, SMALL


def drawn(columns, rows):
    """A board seen straight on, 640x480."""
    squares = np.indices((rows + 1, columns + 1)).sum(axis=0) % 2 * 200 + 30
    board = np.pad(np.kron(squares, np.ones((40, 40))), 40, constant_values=230)
    room = [(0, 480 - board.shape[0]), (0, 640 - board.shape[1])]
    return np.pad(board, room, constant_values=120).astype(np.uint8)


@pytest.fixture
def cut(photographs, tmp_path):
    """A folder of photographs, one of which shows a part of the board only, and no size."""
    for i, number in enumerate((1, 2, 5)):  # those that show all of the board's margin
        write_image(tmp_path / f"{i}.png", read_image(photographs / f"small-{number:02d}.png"))
    part = read_image(photographs / "small-00.png").copy()
    part[:, :250] = 120
    write_image(tmp_path / "part.png", part)
    return tmp_path


def test_the_photographs_tell_the_size(run, cut):
    result = run("detect", cut, "--board", "auto", "-o", "c.vnl", "--json", "--workers", "1")
    assert result.status == 0
    assert "9x6 inner corners: it is seen whole in 3 of 4 images" in result.err
    assert json.loads(result.out)["board"] == "9x6"
    corners = read_corner_table("c.vnl", board=BOARD, image_size=SIZE)
    assert [len(view) for view in corners.views][:3] == [54, 54, 54]


def test_a_part_tells_no_size(run, cut):
    result = run("detect", cut / "part.png", "--board", "auto")
    assert result.status == 1
    assert "no complete checkerboard is visible in 1 image" in result.sentence
    assert "or name the board if it is of another kind" in result.sentence


def test_sizes_that_do_not_agree_are_named(run, cut):
    write_image(cut / "other.png", drawn(7, 5))
    result = run("detect", cut / "0.png", cut / "other.png", "--board", "auto", "--workers", "1")
    assert result.status == 1
    assert "1 of 2 images show 9x6 inner corners and as many show 7x5" in result.sentence
    result = run("detect", cut, "--board", "auto", "--workers", "1")
    assert "9x6 inner corners: it is seen whole in 3 of 5 images" in result.err


def test_a_table_tells_no_size(run, table):
    result = run("calibrate", "--corners", table, "--image-size", "640x480", "--board", "auto")
    assert result.status == 2
    assert "--board auto goes with photographs" in result.err


def test_a_camera_finds_more(run, camera, photographs):
    image = read_image(photographs / "small-02.png").astype(float)
    truth = list(SMALL.photographs(3))[2].corners
    v, u = np.mgrid[0:480, 0:640]
    glare = np.exp(-(((u - truth[30, 0]) ** 2 + (v - truth[30, 1]) ** 2) / (2 * 80.0**2)))
    write_image("glare.png", np.clip(image * (1 - 0.99 * glare) + 250 * glare, 0, 255).astype(np.uint8))
    counts = []
    for options in ((), ("--camera", camera)):
        assert run("detect", "glare.png", "--board", "9x6", *options, "-o", "c.vnl").status == 0
        view = read_corner_table("c.vnl", board=BOARD, image_size=SIZE).views[0]
        assert np.abs(view.uv - truth[view.ids]).max() < 0.3
        counts.append(len(view))
    assert counts[1] > counts[0] >= 20


def test_a_camera_of_another_size_is_refused(run, camera):
    write_image("large.png", np.pad(drawn(9, 6), 20, constant_values=120))
    result = run("detect", "large.png", "--board", "9x6", "--camera", camera)
    assert result.status == 1
    assert "680x520 px, but the camera was calibrated at 640x480" in result.err


def test_reflections_are_not_of_a_camera_that_looks_into_no_mirror(run, camera, photographs):
    result = run("detect", photographs / "small-00.png", "--board", "9x6", "--camera", camera, "--mirrored")
    assert result.status == 2
    assert "is not mirrored, but --mirrored declares the images to be reflections" in " ".join(result.err.split())


@pytest.mark.slow
def test_calibrate_looks_again(run, photographs):
    plain = run("calibrate", photographs, "--board", "9x6", "--no-opencv", "--no-heldout", "-o", "a.npz")
    fine = run("calibrate", photographs, "--board", "9x6", "--no-opencv", "--no-heldout", "-o", "b.npz",
               "--refine-corners")
    assert (plain.status, fine.status) == (0, 0)
    assert "a second look, with the camera known" in fine.err
    before, after = read_camera("a.npz"), read_camera("b.npz")
    truth = {f"{picture.name}.png": picture.corners for picture in SMALL.photographs(7)}
    errors = [
        np.concatenate([view.uv - truth[view.name][view.ids] for view in calibration.corner_set.found])
        for calibration in (before, after)
    ]
    assert (errors[1] ** 2).mean() < (errors[0] ** 2).mean()


def test_a_table_has_nothing_to_look_at(run, table):
    result = run("calibrate", "--corners", table, "--image-size", "640x480", "--board", "9x6", "--refine-corners")
    assert result.status == 2
    assert "a corner table has none" in result.err
