from pathlib import Path

import cv2
import numpy as np
import pytest

from pinholify.board import MARKERS, Charuco, parse_board
from pinholify.detection import detect_board, detect_files
from pinholify.errors import BoardError
from pinholify.geometry import Pose, apply_homography
from pinholify.io.images import image_paths
from pinholify.simulation.lenses import Fisheye
from printed import take

DATA = Path(__file__).parents[2] / "../shared/data/charuco"
SPEC = "charuco:9x7:DICT_4X4_100:0.5"
BOARD = parse_board(SPEC)


def view(homography, *, hide=None, squares=(9, 7), legacy=False):
    """OpenCV's own drawing of the board, warped, and the true corners in px."""
    side = 60
    columns, rows = squares
    drawn = cv2.aruco.CharucoBoard(squares, 1.0, 0.5, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_100))
    drawn.setLegacyPattern(legacy)
    flat = drawn.generateImage((columns * side, rows * side), marginSize=0)
    flat = cv2.copyMakeBorder(flat, side, side, side, side, cv2.BORDER_CONSTANT, value=255)
    if hide is not None:
        flat[hide] = 128
    image = cv2.warpPerspective(flat, homography, (800, 600), flags=cv2.INTER_AREA, borderValue=90)
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    x, y = np.meshgrid(np.arange(columns - 1), np.arange(rows - 1))
    flat_corners = np.stack([x.ravel(), y.ravel()], axis=1) * side + 2 * side - 0.5
    return image, apply_homography(homography, flat_corners)


HOMOGRAPHY = np.array([[0.9, 0.12, 60.0], [-0.05, 0.95, 40.0], [2e-4, 1e-4, 1.0]])


@pytest.mark.parametrize("half_turn", [False, True])
def test_markers_tell_every_corner_by_its_id(half_turn):
    turn = np.array([[-1.0, 0, 799], [0, -1, 599], [0, 0, 1]]) if half_turn else np.eye(3)
    image, truth = view(turn @ HOMOGRAPHY)
    corners = detect_board(image, BOARD)
    assert np.array_equal(corners.ids, np.arange(48))
    assert not corners.orientation_assumed
    assert np.linalg.norm(corners.uv - truth, axis=1).max() < 0.15


def test_markers_tell_a_reflection():
    image, truth = view(HOMOGRAPHY)
    corners = detect_board(image[:, ::-1], BOARD)
    assert np.array_equal(corners.ids, np.arange(48))
    assert np.linalg.norm(corners.uv - (truth * [-1, 1] + [799, 0]), axis=1).max() < 0.15


@pytest.mark.parametrize("squares", [(9, 6), (8, 6), (6, 8), (5, 4)])
@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("reflected", [False, True])
def test_boards_drawn_by_old_opencv_are_known_by_their_markers(squares, legacy, reflected):
    """Before 4.6 an even number of rows began with a white square; calib.io's boards still do."""
    image, truth = view(HOMOGRAPHY, squares=squares, legacy=legacy)
    if reflected:
        image, truth = image[:, ::-1], truth * [-1, 1] + [799, 0]
    corners = detect_board(image, Charuco(squares[0] - 1, squares[1] - 1, "DICT_4X4_100", 0.5))
    assert np.array_equal(corners.ids, np.arange(len(truth)))
    assert np.linalg.norm(corners.uv - truth, axis=1).max() < 0.15


def test_corners_without_markers_get_their_ids_from_the_lattice():
    image, truth = view(HOMOGRAPHY, hide=np.s_[:170, :250])
    corners = detect_board(image, BOARD)
    assert 38 <= len(corners) < 48
    assert np.linalg.norm(corners.uv - truth[corners.ids], axis=1).max() < 0.3


def test_a_plain_board_is_no_charuco_board(board_image):
    image, _ = board_image(8, 6)
    assert "too few markers" in detect_board(image, BOARD).reason


def test_another_dictionary_is_named():
    other = parse_board("charuco:9x7:DICT_5X5_100:0.5")
    reason = detect_board(view(HOMOGRAPHY)[0], other).reason
    assert "those of DICT_4X4_50 or a larger one" in reason


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("charuco:7x9:DICT_4X4_100:0.5", "as on a board of 9 columns of squares, not 7"),
        ("charuco:10x7:DICT_4X4_100:0.5", "as on a board of 9 columns of squares, not 10"),
        ("charuco:9x7:DICT_4X4_100:0.8", "their side is about 0.5 of a square's, not 0.8"),
        ("charuco:9x7:DICT_4X4_100:0.3", "their side is about 0.5 of a square's, not 0.3"),
    ],
)
def test_what_the_markers_say_about_the_board_is_told(spec, words):
    for image in (view(HOMOGRAPHY)[0], view(HOMOGRAPHY)[0][:, ::-1]):
        assert words in detect_board(image, parse_board(spec)).reason


def test_descriptions_are_read_back():
    assert parse_board(SPEC) == Charuco(8, 6, "DICT_4X4_100", 0.5)
    assert parse_board(BOARD.spec) == BOARD
    assert BOARD.orientable


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("charuco:9x7", "write squares"),
        ("charuco:9x7:DICT_4X4_99:0.5", "unknown dictionary"),
        ("charuco:20x20:DICT_4X4_100:0.5", "needs 200 markers"),
        ("charuco:9x7:DICT_4X4_100:1.5", "above 0 and at most 0.98"),
        ("charuco:9x7:DICT_4X4_100:0.99", "white is left around it"),
        ("charuco:3x7:DICT_4X4_100:0.5", "at least 3x3"),
    ],
)
def test_descriptions_that_cannot_be(text, words):
    with pytest.raises(BoardError, match=words):
        parse_board(text)


def test_every_dictionary_is_known_to_opencv():
    for name, count in MARKERS.items():
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        assert len(dictionary.bytesList) == count


@pytest.mark.skipif(not DATA.is_dir(), reason="the real photographs in ../shared/data are not here")
def test_no_fewer_corners_than_opencv_finds():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_100)
    detector = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard((9, 7), 1.0, 0.5, dictionary))
    paths = image_paths([DATA])
    for path, corners in zip(paths, detect_files(paths, BOARD).views, strict=True):
        _, ids, _, _ = detector.detectBoard(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        assert set(ids.ravel()) <= set(corners.ids)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_fisheye_hides_no_corner(seed):
    """Homographies over several squares, which is how OpenCV gets from markers to corners, do not fit here."""
    board = parse_board("charuco:12x9:DICT_4X4_100:0.7")
    lens = Fisheye((960, 720), 300.0)
    turn = cv2.Rodrigues(np.array([0.1, -0.5 + 0.8 * seed, 0.05]))[0]
    pose = Pose(turn, np.array([0.0, 0.0, 4.0]) - turn @ [5.0, 3.5, 0.0])
    image, truth = take(lens, board, pose)
    corners = detect_board(image, board)
    visible = (truth > 6).all(axis=1) & (truth < np.array(lens.size) - 7).all(axis=1)
    assert set(np.flatnonzero(visible)) <= set(corners.ids)
    assert np.linalg.norm(corners.uv - truth[corners.ids], axis=1).max() < 0.2
