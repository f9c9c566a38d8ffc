"""No AprilGrid and no circle grid where none is, nor where another kind of board is."""

import numpy as np
import pytest
from test_aprilgrid import HOMOGRAPHY, flat_picture
from test_no_board import NOTHING, alternating_floor

from pinholify.board import parse_board
from pinholify.detection import detect_board

KINDS = [*NOTHING, alternating_floor]
BOARDS = ["aprilgrid:6x6:tag36h11:0.3", "aprilgrid:2x2:tag16h5:0.3", "circles:7x5", "circles:4x11:asymmetric"]


def found_in(kind, seeds, specs, part=np.s_[:]):
    pictures = [(seed, np.ascontiguousarray(kind(np.random.default_rng([seed, 77]))[part])) for seed in seeds]
    seen = [(seed, spec, detect_board(picture, parse_board(spec))) for seed, picture in pictures for spec in specs]
    return [(seed, spec) for seed, spec, corners in seen if corners.found]


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_seen_where_nothing_is(kind):
    assert not found_in(kind, range(2), [BOARDS[0], BOARDS[2]], np.s_[:200, :300])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_seen_in_many_pictures(kind):
    assert not found_in(kind, range(100, 130), BOARDS)


@pytest.mark.parametrize("spec", [*BOARDS, "charuco:9x7:DICT_4X4_100:0.5"])
def test_a_checkerboard_is_no_other_board(spec, board_image):
    corners = detect_board(board_image(8, 6)[0], parse_board(spec))
    assert not corners.found
    assert corners.reason


@pytest.mark.parametrize("spec", ["9x6", "circles:7x5", "charuco:9x7:DICT_4X4_100:0.5"])
def test_an_aprilgrid_is_no_other_board(spec):
    image, _ = flat_picture(parse_board(BOARDS[0]), HOMOGRAPHY)
    assert not detect_board(image, parse_board(spec)).found
