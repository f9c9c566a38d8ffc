from pathlib import Path

import numpy as np
import pytest

from pinholify.board import BOARD_KINDS, Checkerboard, parse_board, size
from pinholify.detection import detect_board, detect_files
from pinholify.detection.detect import DETECTORS
from pinholify.errors import BoardError
from pinholify.io.images import image_paths

DATA = Path(__file__).parents[2] / "../shared/data"


@pytest.mark.parametrize("convert", [np.uint8, np.uint16, np.float64, "colour"])
def test_corners_are_where_they_were_rendered(board_image, convert):
    image, truth = board_image(8, 6)
    if convert == "colour":
        image = np.repeat(image[:, :, None], 3, axis=2)
    else:
        image = image.astype(convert) * (200 if convert == np.uint16 else 1)
    corners = detect_board(image, Checkerboard(8, 6), name="x")
    assert np.array_equal(corners.ids, np.arange(48))
    assert corners.orientation_assumed
    error = corners.uv - truth
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.05
    assert np.linalg.norm(error.mean(axis=0)) < 0.02


@pytest.mark.parametrize("half_turns", [0, 1])
def test_the_black_square_tells_the_ends_of_an_odd_board(board_image, half_turns):
    image, truth = board_image(7, 6)
    if half_turns:
        image, truth = image[::-1, ::-1], [639, 479] - truth
    corners = detect_board(image, Checkerboard(7, 6))
    assert not corners.orientation_assumed
    assert np.abs(corners.uv - truth[corners.ids]).max() < 0.2


def test_a_mirror_reverses_the_board(board_image):
    image, truth = board_image(7, 6)
    corners = detect_board(image[:, ::-1], Checkerboard(7, 6), mirrored=True)
    assert np.abs(corners.uv - ([639, 0] + truth * [-1, 1])[corners.ids]).max() < 0.2


def test_an_image_without_a_board_gives_a_reason():
    noise = np.random.default_rng(0).integers(0, 255, (300, 400), dtype=np.uint8)
    for image in [np.zeros((300, 400), np.uint8), noise]:
        assert "no board of 8x6" in detect_board(image, Checkerboard(8, 6)).reason
    assert "too small" in detect_board(np.zeros((1, 1), np.uint8), Checkerboard(8, 6)).reason


def test_every_kind_of_board_but_a_screen_has_its_detector():
    specs = {"checkerboard": "8x6", "charuco": "charuco:9x7:DICT_4X4_100:0.5", "gray": "gray:640x480",
             "aprilgrid": "aprilgrid:6x6:tag36h11:0.3", "circles": "circles:7x5"}
    assert specs.keys() == BOARD_KINDS.keys()
    boards = {kind: type(parse_board(spec)) for kind, spec in specs.items()}
    assert set(boards.values()) - DETECTORS.keys() == {boards["gray"]}
    with pytest.raises(BoardError, match="decode captures of all its patterns"):
        detect_board(np.zeros((300, 400), np.uint8), parse_board(specs["gray"]))


@pytest.mark.skipif(not DATA.is_dir(), reason="the real photographs in ../shared/data are not here")
@pytest.mark.parametrize(
    ("folder", "board", "least"), [("gopro_wide", "8x6", 35), ("webcam_mild", "9x6", 13)]
)
def test_boards_in_real_photographs_are_found(folder, board, least):
    corners = detect_files(image_paths([DATA / folder]), parse_board(board))
    complete = [view for view in corners.found if len(view) == size(corners.board)]
    assert len(complete) == least
    # Two photographs of gopro_wide show a part of the board only, and not which part.
    assert all(view.ambiguous_offset for view in corners.found if view not in complete)
