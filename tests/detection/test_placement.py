"""What hides a part of a board does not pass for the board's end: its ids are right, or marked as not known."""

import numpy as np
import pytest

from pinholify.board import Checkerboard, lattice
from pinholify.detection import detect_board, detect_size
from pinholify.detection.intensity import grey_levels
from pinholify.detection.lattice import Lattice
from pinholify.detection.placement import ends, within_margins
from pinholify.geometry import apply_homography

BOARD = Checkerboard(9, 6)
HOMOGRAPHY = np.array([[52.0, 5.0, 70.0], [-6.0, 51.0, 105.0], [0.0, 0.00001, 1.0]])
U, V = np.meshgrid(np.arange(640.0), np.arange(480.0))


@pytest.fixture
def view(board_image):
    """A picture of the whole board, and its corners (54, 2)."""
    return board_image(9, 6, homography=HOMOGRAPHY)


def on_board(homography):
    """The board's coordinates (480, 640, 2), in squares, of every pixel."""
    pixels = np.stack([U.ravel(), V.ravel()], axis=1)
    return apply_homography(np.linalg.inv(homography), pixels).reshape(480, 640, 2)


def error(corners, truth):
    return np.median(np.linalg.norm(corners.uv - truth[corners.ids], axis=1))


def beyond(angle, cut):
    """The pixels of a half plane, behind the share ``cut`` of the corners seen in the direction ``angle`` (degrees)."""
    direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    along = apply_homography(HOMOGRAPHY, lattice(BOARD)) @ direction
    return direction[0] * U + direction[1] * V > np.quantile(along, cut)


@pytest.mark.parametrize("grey", [0, 25, 90, 150])
def test_a_mat_around_a_part_is_no_end_of_the_board(view, grey):
    image, truth = view
    window = (abs(U - 320) < 200) & (abs(V - 230) < 125)
    corners = detect_board(np.where(window, image, np.uint8(grey)), BOARD)
    assert corners.ambiguous_offset
    assert np.ptp(truth[corners.ids] - corners.uv, axis=0).max() < 8  # one offset of the lattice, not a scramble


def test_the_black_surround_of_a_fisheye_image_is_no_end_of_the_board(view):
    """The top and the left end are seen, the others are dark."""
    image, truth = view
    corners = detect_board(np.where(np.hypot(U - 200, V - 190) < 225, image, np.uint8(0)), BOARD)
    assert 27 <= len(corners) < 54
    assert not corners.ambiguous_offset
    assert error(corners, truth) < 0.1


@pytest.mark.parametrize("angle", [0, 35, 90, 120, 200])
@pytest.mark.parametrize("grey", [20, 150, 220])
def test_a_straight_edge_before_the_board_does_not_make_it_smaller(view, angle, grey):
    image, truth = view
    corners = detect_board(np.where(beyond(angle, 0.66), np.uint8(grey), image), BOARD)
    assert len(corners) >= 27
    assert corners.ambiguous_offset or error(corners, truth) < 0.1


@pytest.mark.parametrize("light", [0.25, 0.1])
def test_the_edge_of_a_shadow_is_no_end_of_the_board(view, light):
    image, truth = view
    corners = detect_board(np.where(beyond(35, 0.6), image * light, image).astype(np.uint8), BOARD)
    assert len(corners) >= 27
    assert corners.ambiguous_offset or error(corners, truth) < 0.1


def test_ends_are_told_by_the_width_of_the_outer_squares(view):
    image, truth = view
    part = Lattice(lattice(BOARD).astype(np.int64), truth, np.ones(54), -1)
    seen = ends(grey_levels(image), part)
    assert np.allclose([seen.left, seen.right, seen.top, seen.bottom], 1, atol=0.05)
    assert seen.whole
    paper = np.where(on_board(HOMOGRAPHY)[:, :, 0] > 8.6, np.uint8(225), image)
    cut = ends(grey_levels(paper), part)
    assert cut.right == pytest.approx(0.6, abs=0.05)
    assert min(cut.left, cut.top, cut.bottom) > 0.9
    assert not cut.whole
    dark = ends(grey_levels(np.where(on_board(HOMOGRAPHY)[:, :, 0] > 9, np.uint8(25), image)), part)
    assert not dark.right


def test_no_end_is_seen_where_the_board_goes_on(view):
    image, truth = view
    index = lattice(BOARD).astype(np.int64)
    inner = ((index > 0) & (index < [8, 5])).all(axis=1)
    part = Lattice(index[inner], truth[inner], np.ones(inner.sum()), -1).at_origin()
    seen = ends(grey_levels(image), part)
    assert max(seen.left, seen.right, seen.top, seen.bottom) == 0


def test_a_corner_beyond_the_margin_is_not_the_boards(view):
    image, truth = view
    index = lattice(BOARD).astype(np.int64)
    index, truth = index[index[:, 0] > 3], truth[index[:, 0] > 3]
    stray = np.array([[6, -1]])
    with_stray = Lattice(index, truth, np.ones(len(truth)), -1).joined(stray, apply_homography(HOMOGRAPHY, stray))
    kept = within_margins(grey_levels(image), with_stray.at_origin())
    assert len(kept) == len(truth)
    assert kept.extent == (5, 6)


def test_a_lone_corner_of_the_board_stays(view):
    image, truth = view
    index = lattice(BOARD).astype(np.int64)
    part = (index[:, 1] < 4) | ((index == [4, 4]).all(axis=1))
    seen = Lattice(index[part], truth[part], np.ones(part.sum()), -1)
    assert len(within_margins(grey_levels(image), seen)) == part.sum()


def test_a_board_of_cut_squares_and_a_thin_margin_has_a_size(board_image):
    """As many that are printed to the paper's edge: half squares at both sides, little white, then the table."""
    image, _ = board_image(8, 6, homography=HOMOGRAPHY)
    x, y = on_board(HOMOGRAPHY).transpose(2, 0, 1)
    image = np.where((x < -0.5) | (x > 7.5), np.uint8(225), image)
    image = np.where((x < -0.7) | (x > 7.7) | (y < -1.2) | (y > 6.2), np.uint8(110), image)
    assert detect_board(image, Checkerboard(9, 6)).reason == "the board has 8x6 inner corners, not 9x6"
    assert detect_size(image) == Checkerboard(8, 6)
    assert len(detect_board(image, Checkerboard(8, 6))) == 48


def test_a_board_without_a_margin_is_whole_where_all_of_it_is_seen(view):
    image, truth = view
    x, y = on_board(HOMOGRAPHY).transpose(2, 0, 1)
    corners = detect_board(np.where((x < -1) | (x > 9) | (y < -1) | (y > 6), np.uint8(60), image), BOARD)
    assert np.array_equal(corners.ids, np.arange(54))
    assert not corners.ambiguous_offset
    assert error(corners, truth) < 0.1
