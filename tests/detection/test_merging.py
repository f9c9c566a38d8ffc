"""Boards that something splits in parts, and boards that are no parts of one another."""

import cv2
import numpy as np
import pytest

from pinholify.board import Checkerboard
from pinholify.detection import detect_board
from pinholify.detection.lattice import Lattice
from pinholify.detection.merging import joined, merged
from pinholify.geometry import apply_homography

BOARD = Checkerboard(15, 9)
VIEW = np.array([[44.0, 5.0, 60.0], [-4.0, 46.0, 60.0], [0.006, 0.01, 1.0]])


def pole(image, width, homography=VIEW, across=False):
    """A grey pole ``width`` squares wide over the middle of the board; corners up to it are hidden."""
    ends = np.array([[7 - width / 2, -3], [7 + width / 2, -3], [7.4 + width / 2, 12], [7.4 - width / 2, 12]])
    if across:
        ends = np.array([[-3, 4 - width / 2], [-3, 4 + width / 2], [18, 4.3 + width / 2], [18, 4.3 - width / 2]])
    outline = apply_homography(homography, ends).astype(np.float32)
    cv2.fillConvexPoly(image, np.rint(outline).astype(np.int32), 90)
    return outline


def clear_of(outline, uv):
    return np.array([cv2.pointPolygonTest(outline, (float(u), float(v)), True) < -8 for u, v in uv])


@pytest.mark.parametrize(("width", "across"), [(2.2, False), (3.2, False), (4.4, False), (2.2, True), (3.2, True)])
def test_a_pole_before_the_board_parts_nothing(board_image, width, across):
    image, truth = board_image(15, 9, homography=VIEW, size=(800, 640))
    outline = pole(image, width, across=across)
    corners = detect_board(image, BOARD)
    visible = (truth > 8).all(axis=1) & (truth < [791, 631]).all(axis=1) & clear_of(outline, truth)
    places = truth if np.linalg.norm(corners.uv[0] - truth[corners.ids[0]]) < 5 else truth[::-1]
    assert set(np.flatnonzero(visible)) <= set(corners.ids)
    assert np.linalg.norm(corners.uv - places[corners.ids], axis=1).max() < 0.5
    assert not corners.ambiguous_offset


def lattice(columns, rows, homography, *, start=(0, 0), phase=1):
    index = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    uv = apply_homography(homography, (index + np.array(start)).astype(float))
    return Lattice(index, uv, np.ones(len(index)), phase)


def test_parts_are_joined_whichever_way_they_were_counted():
    first = lattice(5, 6, VIEW)
    second = lattice(4, 6, VIEW, start=(8, 0))
    for way in (second, second.turned(), second.turned().turned(), second.shifted((3, -7))):
        whole = joined(first, way)
        assert whole is not None
        assert whole.extent == (12, 6)
        expected = apply_homography(VIEW, whole.index.astype(float))
        assert np.abs(whole.uv - expected).max() < 1e-9


@pytest.mark.parametrize(
    "second",
    [
        lattice(5, 6, VIEW, start=(7.5, 0.0)),  # half a square off
        lattice(5, 6, VIEW, start=(8, 0), phase=-1),  # black where white should be
        lattice(5, 6, VIEW @ np.diag([1.3, 1.3, 1.0]), start=(6, 0)),  # larger squares
        lattice(5, 6, VIEW, start=(30, 0)),  # too far to tell
        lattice(5, 6, VIEW, start=(2, 2)),  # corners that the first has itself
    ],
)
def test_what_is_no_part_is_not_joined(second):
    assert joined(lattice(5, 6, VIEW), second) is None


def test_three_parts_make_one():
    parts = [lattice(4, 6, VIEW, start=(6 * k, 0)) for k in range(3)]
    alone = lattice(4, 5, np.array([[20.0, 3.0, 400.0], [-3.0, 20.0, 500.0], [0, 0, 1.0]]))
    wholes = merged([parts[0], alone, parts[2], parts[1]])
    assert [len(whole) for whole in wholes] == [72]
    assert sorted(wholes[0].extent) == [6, 16]


def test_two_boards_in_line_stay_two(board_image):
    """As far apart as a pole would part one board, and the corners of one are on the other's lines."""
    image, _ = board_image(5, 6, homography=np.array([[40.0, 0, 60.0], [0, 40.0, 100.0], [0, 0, 1.0]]))
    other, _ = board_image(5, 6, homography=np.array([[40.0, 0, 380.0], [0, 40.0, 100.0], [0, 0, 1.0]]))
    both = np.where(np.arange(640)[None] < 300, image, other)
    corners = detect_board(both, Checkerboard(5, 6))
    assert len(corners) == 30
    assert np.ptp(corners.uv[:, 0]) < 170
