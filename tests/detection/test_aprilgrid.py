import cv2
import numpy as np
import pytest

from pinholify.board import FAMILIES, AprilGrid, lattice, parse_board
from pinholify.detection import detect_board
from pinholify.errors import BoardError
from pinholify.geometry import Pose, apply_homography
from pinholify.io.board_print import ARTWORKS
from pinholify.simulation.lenses import LENSES, Pinhole, Resized
from pinholify.simulation.photograph import Sensor
from pinholify.simulation.views import board_poses
from printed import printed, take

SPEC = "aprilgrid:6x6:tag36h11:0.3"
BOARD = parse_board(SPEC)
HOMOGRAPHY = np.array([[52.0, 5.0, 120.0], [-3.0, 50.0, 70.0], [6e-3, 4e-3, 1.0]])


def flat_picture(board, homography, *, size=(640, 480), white=()):
    """The board drawn through ``homography`` (tags to px), smoothed, and its true corners; ``white`` tags are blank."""
    cells = 40
    sheet = printed(board, cells=cells, margin=1.0)
    to_sheet = np.array([[cells, 0, -sheet.origin[0] * cells], [0, cells, -sheet.origin[1] * cells], [0, 0, 1]])
    pixels = 255 * sheet.pixels[:, :, 0]
    for k in white:
        x, y = (lattice(board)[k] - sheet.origin) * cells
        pixels[round(y) : round(y) + cells, round(x) : round(x) + cells] = 230
    fine = np.array([[4.0, 0, 1.5], [0, 4, 1.5], [0, 0, 1]])  # 4 × 4 finer pixels
    warp = fine @ homography @ np.linalg.inv(to_sheet)
    picture = cv2.warpPerspective(pixels, warp, (4 * size[0], 4 * size[1]), borderValue=120.0)
    picture = cv2.resize(cv2.GaussianBlur(picture, (0, 0), 3.0), size, interpolation=cv2.INTER_AREA)
    picture += np.random.default_rng(0).normal(0, 2, picture.shape)
    return np.clip(picture, 0, 255).astype(np.uint8), apply_homography(homography, lattice(board))


def errors(corners, truth):
    return np.linalg.norm(corners.uv - truth[corners.ids], axis=1)


@pytest.mark.parametrize("half_turn", [False, True])
def test_every_corner_by_its_id(half_turn):
    """Corner 0 is the top left one of the board as it hangs, whatever the image shows at the top."""
    turn = np.array([[-1.0, 0, 639], [0, -1, 479], [0, 0, 1]]) if half_turn else np.eye(3)
    image, truth = flat_picture(BOARD, turn @ HOMOGRAPHY)
    corners = detect_board(image, BOARD)
    assert np.array_equal(corners.ids, np.arange(144))
    assert not corners.orientation_assumed
    assert not corners.ambiguous_offset
    assert np.sqrt((errors(corners, truth) ** 2).mean()) < 0.05


@pytest.mark.parametrize("spec", ["aprilgrid:3x2:tag36h11:0.3", "aprilgrid:2x3:tag16h5:0.5"])
@pytest.mark.parametrize("side", [20, 120, 250, 600])
def test_prints_of_every_size(spec, side):
    """Tags of 20 px and of 600 px, with edges as sharp as a print's own: every corner, and no bias."""
    board = parse_board(spec)
    sheet = printed(board, cells=side)
    noise = np.random.default_rng(0).normal(0, 2, sheet.pixels.shape[:2])
    corners = detect_board(np.clip(255 * sheet.pixels[:, :, 0] + noise, 0, 255).astype(np.uint8), board)
    truth = (lattice(board) - sheet.origin) * side
    assert np.array_equal(corners.ids, np.arange(len(truth)))
    assert errors(corners, truth).max() < 0.15
    assert np.abs((corners.uv - truth).mean(axis=0)).max() < 0.03


def test_near_and_far_tags_of_one_board():
    """Seen along its rows, a board has tags 290 px high at one end and 180 px at the other."""
    board = parse_board("aprilgrid:6x2:tag36h11:0.3")
    steep = np.array([[330.0, 0, 130], [60, 300, 100], [0.1, 0, 1]])
    image, truth = flat_picture(board, steep, size=(1600, 860))
    corners = detect_board(image, board)
    assert len(corners) == 48
    assert errors(corners, truth).max() < 0.3


@pytest.mark.parametrize("side", [21, 22, 24])
def test_tags_that_end_inside_their_corners(side):
    """OpenCV ends small tags up to three pixels too early where black squares touch them."""
    board = parse_board("aprilgrid:6x4:tag36h11:0.3")
    turned = side * np.array([[0.94, -0.34, 5.0], [0.34, 0.94, 3.0], [0, 0, 1 / side]])
    image, truth = flat_picture(board, turned, size=(320, 320))
    corners = detect_board(image, board)
    assert len(corners) == 96
    assert errors(corners, truth).max() < 0.3


def test_tags_tell_a_reflection():
    image, truth = flat_picture(BOARD, HOMOGRAPHY)
    corners = detect_board(image[:, ::-1], BOARD)
    assert np.array_equal(corners.ids, np.arange(144))
    assert errors(corners, truth * [-1, 1] + [639, 0]).max() < 0.3


@pytest.mark.parametrize("name", ["pinhole", "unity-barrel", "fisheye"])
def test_corners_of_rendered_boards(name):
    """All ids right, no bias, a few hundredths of a pixel, through a strong fisheye too."""
    lens = Resized(LENSES[name], (720, round(720 * LENSES[name].size[1] / LENSES[name].size[0])))
    for seed, pose in enumerate(board_poses([lens], BOARD, 2, seed=3, margin=0.012, tilt=35)):
        image, truth = take(lens, BOARD, pose, seed=seed)
        corners = detect_board(image, BOARD)
        error = corners.uv - truth[corners.ids]
        assert len(corners) >= 140
        assert np.sqrt((error**2).sum(axis=1).mean()) < 0.04
        assert np.abs(error.mean(axis=0)).max() < 0.01


def test_a_part_of_the_board_keeps_its_ids():
    image, truth = flat_picture(BOARD, HOMOGRAPHY)
    corners = detect_board(np.ascontiguousarray(image[150:, 230:]), BOARD)
    visible = ((truth >= [236, 156]) & (truth <= [633, 473])).all(axis=1)
    assert 0.9 * visible.sum() <= len(corners) < 144
    assert errors(corners, truth - [230, 150]).max() < 0.3


def test_corners_of_tags_that_cannot_be_read_are_found():
    """Blank tags leave no crossing at their corners, but their neighbours' stay; a spoilt code costs nothing."""
    image, truth = flat_picture(BOARD, HOMOGRAPHY)
    x, y = truth[[26, 27, 38, 39]].mean(axis=0)  # inside the tag of corners 26, 27, 38, 39
    spoilt = cv2.circle(image.copy(), (round(x), round(y)), 12, 15, -1)
    assert len(detect_board(spoilt, BOARD)) == 144
    blank, truth = flat_picture(BOARD, HOMOGRAPHY, white=[26])
    corners = detect_board(blank, BOARD)
    assert set(range(144)) - set(corners.ids.tolist()) == {26, 27, 38, 39}
    assert errors(corners, truth).max() < 0.3


def test_plain_tags_are_refused_with_the_reason():
    """Without the squares between tags their corners are no crossings."""
    cells, board = 40, parse_board("aprilgrid:3x3:tag36h11:0.3")
    drawn = np.full((200, 200), 230, np.uint8)
    artwork = ARTWORKS[AprilGrid](board)
    for r in artwork.black:
        if not np.isclose(r.width, r.height) or not np.isclose(r.width, 0.3):
            x0, y0, x1, y1 = (20 + round(cells * v) for v in (r.x, r.y, r.x + r.width, r.y + r.height))
            drawn[y0:y1, x0:x1] = 20
    corners = detect_board(cv2.GaussianBlur(drawn, (0, 0), 0.8), board)
    assert not corners.found
    assert "squares between their corners" in corners.reason


def test_noise_small_tags_and_darkness():
    image, truth = flat_picture(BOARD, np.diag([0.5, 0.5, 1]) @ HOMOGRAPHY, size=(320, 240))
    assert len(detect_board(image, BOARD)) > 130
    corners = detect_board((0.1 * image + 3).astype(np.uint8), BOARD)
    assert len(corners) > 120
    assert errors(corners, truth).max() < 0.6
    noisy = cv2.add(image, np.random.default_rng(1).normal(0, 12, image.shape), dtype=cv2.CV_8U)
    assert len(detect_board(noisy, BOARD)) > 100


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_is_printed_and_read(family):
    board = AprilGrid(3, 2, family, 0.25)
    image, truth = flat_picture(board, np.array([[90.0, 5.0, 120.0], [-3.0, 92.0, 100.0], [1e-2, 1e-2, 1.0]]))
    corners = detect_board(image, board)
    assert len(corners) == 24
    assert errors(corners, truth).max() < 0.2


def test_a_board_of_other_tags_is_another_board(board_image):
    image, _ = flat_picture(BOARD, HOMOGRAPHY)
    assert "no tag" in detect_board(image, parse_board("aprilgrid:6x5:tag25h9:0.3")).reason
    assert "no tag" in detect_board(board_image(8, 6)[0], BOARD).reason


def test_a_tag_of_another_place_is_left_out():
    """One wild tag that carries a number of the board, beside the board, changes nothing."""
    image, truth = flat_picture(BOARD, HOMOGRAPHY, size=(760, 480), white=[0])  # tag 30 is blank
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    wild = cv2.aruco.generateImageMarker(family, 30, 80, borderBits=2)
    image[200:300, 640:740] = 230
    image[210:290, 650:730] = wild
    corners = detect_board(image, BOARD)
    assert len(corners) == 140
    assert errors(corners, truth).max() < 0.3


def test_descriptions_and_places():
    assert parse_board(SPEC) == AprilGrid(6, 6, "tag36h11", 0.3)
    assert parse_board(BOARD.spec) == BOARD
    assert BOARD.orientable
    np.testing.assert_allclose(lattice(BOARD)[[0, 1, 2, 12, 24, 143]],
                               [[0, 0], [1, 0], [1.3, 0], [0, 1], [0, 1.3], [7.5, 7.5]])
    assert BOARD.tag_number(np.array([0, 5, 0]), np.array([5, 5, 0])).tolist() == [0, 5, 30]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("aprilgrid:6x6", "write tags"),
        ("aprilgrid:6x6:t36h11:0.3", "unknown family"),
        ("aprilgrid:6x6:tag25h9:0.3", "needs 36 tags"),
        ("aprilgrid:1x6:tag36h11:0.3", "at least 2x2"),
        ("aprilgrid:6x6:tag36h11:1.3", "above 0 and at most 1"),
    ],
)
def test_descriptions_that_cannot_be(text, words):
    with pytest.raises(BoardError, match=words):
        parse_board(text)


def test_blur_of_two_pixels_costs_no_ids():
    lens = Pinhole((720, 540), 600.0)
    pose = Pose(np.eye(3), np.array([-3.75, -3.75, 9.5]))
    image, truth = take(lens, BOARD, pose, sensor=Sensor(blur=2.0, read_noise=2.0))
    corners = detect_board(image, BOARD)
    assert len(corners) > 120
    assert errors(corners, truth).max() < 0.3


def shown(size, family="tag36h11"):
    return flat_picture(parse_board(f"aprilgrid:{size}:{family}:0.3"), HOMOGRAPHY)[0]


@pytest.mark.parametrize(
    ("size", "asked", "words"),
    [
        ("4x5", "6x6", "4 across and at least 5 down, not as on aprilgrid:6x6"),
        ("5x6", "6x6", "5 across and at least 6 down"),
        ("6x6", "4x5", "6 across and at least 6 down"),
        ("6x6", "6x4", "at least 6x6 tags is larger than aprilgrid:6x4"),
    ],
)
def test_a_grid_of_another_size_is_refused_with_its_size(size, asked, words):
    found = detect_board(shown(size), parse_board(f"aprilgrid:{asked}:tag36h11:0.3"))
    assert words in found.reason
    assert found.larger_board == ("larger" in words)


def test_another_family_is_named():
    assert "tags of tag25h9, 5 across and at least 4 down" in detect_board(shown("5x4", "tag25h9"), BOARD).reason


@pytest.mark.parametrize("gap", [0.2, 0.28, 0.33, 0.45])
@pytest.mark.parametrize("name", ["pinhole", "fisheye"])
def test_a_mistaken_gap_is_refused_with_the_right_one(name, gap):
    """However the lens bends the board, its tags tell the gap between them."""
    lens = Resized(LENSES[name], (720, round(720 * LENSES[name].size[1] / LENSES[name].size[0])))
    image, _ = take(lens, BOARD, board_poses([lens], BOARD, 2, seed=3, margin=0.012, tilt=35)[1])
    reason = detect_board(image, parse_board(f"aprilgrid:6x6:tag36h11:{gap}")).reason
    said = float(reason.split("between the tags is ")[1].split()[0])
    assert said == pytest.approx(0.3, abs=0.011)
    assert f"give aprilgrid:6x6:tag36h11:{said:.2f}" in reason
