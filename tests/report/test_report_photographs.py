"""Photographs are matched by name, and a camera file leads nowhere outside its folder."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pinholify.errors import ImageError, InputError
from pinholify.io.images import write_image
from pinholify.report.photographs import matched, nearby
from pinholify.report.pictures import read_pictures
from small_camera import SIZE


def test_files_are_matched_by_the_end_of_their_path():
    paths = [Path("x/left/1.png"), Path("x/right/1.png"), Path("x/2.png"), Path("x/3.png")]
    found = matched(["left/1.png", "right/1.png", "2.png"], paths)
    assert found.by_name == {"left/1.png": paths[0], "right/1.png": paths[1], "2.png": paths[2]}
    assert found.others == (paths[3],)


def test_a_name_is_matched_whole_not_in_part():
    assert matched(["1.png"], [Path("x/11.png")]).by_name == {}


def test_two_files_of_one_name_are_refused():
    with pytest.raises(InputError, match=r"are called '1\.png'"):
        matched(["1.png"], [Path("x/1.png"), Path("y/1.png")])


def test_photographs_are_found_beside_the_camera(tmp_path):
    (tmp_path / "a.png").touch()
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "b.png").touch()
    (tmp_path / "secret.png").touch()
    inside = tmp_path / "sub"
    names = ["a.png", "b.png", "../secret.png", str(tmp_path / "secret.png")]
    assert nearby(names, [inside, tmp_path]).by_name == {"a.png": tmp_path / "a.png", "b.png": inside / "b.png"}


def test_pictures_that_do_not_fit_are_missing_with_the_reason(evaluation, tmp_path):
    write_image(tmp_path / "small.png", np.zeros((10, 10, 3), np.uint8))
    (tmp_path / "broken.png").write_bytes(b"not an image")
    read = []
    pictures = read_pictures(
        evaluation.calibration,
        {"a0.png": tmp_path / "small.png", "a2.png": tmp_path / "broken.png"},
        on_read=lambda: read.append(1),
    )
    assert len(read) == 2
    assert "is 10x10 and the camera was calibrated at 640x480" in pictures.missing["a0.png"]
    assert "cannot be read" in pictures.missing["a2.png"]
    assert pictures.missing["a3.png"] == "not given"
    assert not pictures.thumbnails
    assert not pictures.frames


def test_another_photograph_of_the_camera_is_framed_instead_of_a_boardless_one(evaluation, folder, tmp_path):
    other = tmp_path / "other.png"
    write_image(other, np.full((SIZE[1], SIZE[0]), 40000, np.uint16))
    photographs = {"a0.png": folder / "a0.png", "street.png": folder / "street.png"}
    frames = read_pictures(evaluation.calibration, photographs, [other]).frames
    assert [frame.name for frame in frames] == ["a0.png", "other.png"]
    shown = cv2.imdecode(np.frombuffer(frames[1].before.data, np.uint8), cv2.IMREAD_COLOR)
    assert abs(float(shown.mean()) - 40000 / 256) < 2  # 16 bits are shown as 8


def test_another_photograph_of_another_size_is_refused(evaluation, tmp_path):
    write_image(tmp_path / "other.png", np.zeros((10, 10), np.uint8))
    with pytest.raises(ImageError, match="10x10"):
        read_pictures(evaluation.calibration, {}, [tmp_path / "other.png"])
