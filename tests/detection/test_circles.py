import cv2
import numpy as np
import pytest

from pinholify.board import CircleGrid, lattice, parse_board
from pinholify.calibration.circles import centroids_inside
from pinholify.detection import detect_board
from pinholify.errors import BoardError
from pinholify.geometry import Pose
from pinholify.simulation.lenses import LENSES, Pinhole, Resized
from pinholify.simulation.photograph import Sensor
from pinholify.simulation.views import board_poses
from printed import take

SYMMETRIC, ASYMMETRIC = CircleGrid(7, 5), CircleGrid(4, 11, asymmetric=True, diameter=0.8)
BOARDS = pytest.mark.parametrize("board", [SYMMETRIC, ASYMMETRIC], ids=["symmetric", "asymmetric"])
LENS = Pinhole((640, 480), 560.0)


def turned(x, y, z):
    """A rotation by ``z``, then ``y``, then ``x`` degrees about these axes."""
    (cx, sx), (cy, sy), (cz, sz) = ((np.cos(a), np.sin(a)) for a in np.deg2rad([x, y, z]))
    return (
        np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    )


def pose_of(board, rotation, distance):
    middle = np.append(lattice(board).max(axis=0) / 2, 0.0)
    return Pose(rotation, np.array([0.0, 0.0, distance]) - rotation @ middle)


def centroids(lens, board, pose):
    """The true centroids of the images of the discs."""
    angle = np.arange(90) * np.pi / 45
    ring = board.diameter / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline = (lattice(board)[:, None] + ring).reshape(-1, 2)
    return centroids_inside(lens.project(pose.apply(outline)).reshape(-1, 90, 2))


@pytest.fixture(scope="module", params=[SYMMETRIC, ASYMMETRIC], ids=["symmetric", "asymmetric"])
def slanted(request):
    """A board seen at a slant: itself, its photograph, and the true centroids."""
    board = request.param
    pose = pose_of(board, turned(28, -24, 9), 1.65 * max(lattice(board).max(axis=0)))
    image, _ = take(LENS, board, pose)
    return board, image, centroids(LENS, board, pose)


def errors(corners, truth):
    return np.linalg.norm(corners.uv - truth[corners.ids], axis=1)


def test_every_circle_by_its_id(slanted):
    board, image, truth = slanted
    corners = detect_board(image, board)
    assert np.array_equal(corners.ids, np.arange(len(truth)))
    assert corners.orientation_assumed == (not board.orientable)
    assert np.sqrt((errors(corners, truth) ** 2).mean()) < 0.03
    assert np.abs((corners.uv - truth).mean(axis=0)).max() < 0.01


def test_an_odd_asymmetric_grid_tells_a_half_turn_and_others_do_not(slanted):
    """Where nothing tells, circle 0 is the end nearest to the image's top left."""
    board, image, truth = slanted
    corners = detect_board(np.ascontiguousarray(image[::-1, ::-1]), board)
    there = [639, 479] - truth
    if not board.orientable:
        there = there[::-1]
    assert errors(corners, there).max() < 0.1


@pytest.mark.parametrize("name", ["unity-barrel", "fisheye"])
@BOARDS
def test_circles_of_rendered_boards(name, board):
    lens = Resized(LENSES[name], (720, round(720 * LENSES[name].size[1] / LENSES[name].size[0])))
    for seed, pose in enumerate(board_poses([lens], board, 2, seed=3, margin=0.03, tilt=35)):
        image, _ = take(lens, board, pose, seed=seed)
        truth = centroids(lens, board, pose)
        corners = detect_board(image, board)
        assert len(corners) == len(truth)
        ends = [errors(corners, truth)] if board.orientable else [errors(corners, t) for t in (truth, truth[::-1])]
        assert np.sqrt((min(ends, key=np.sum) ** 2).mean()) < 0.04


def test_mirrored_images_are_told():
    pose = pose_of(SYMMETRIC, turned(20, 15, 5), 8.0)
    image, _ = take(LENS, SYMMETRIC, pose)
    truth = centroids(LENS, SYMMETRIC, pose) * [-1, 1] + [639, 0]
    corners = detect_board(np.ascontiguousarray(image[:, ::-1]), SYMMETRIC, mirrored=True)
    assert min(errors(corners, t).max() for t in (truth, truth[::-1])) < 0.1


def test_covered_circles_are_left_out_whole_or_in_part(slanted):
    board, image, truth = slanted
    hand = image.copy()
    place = truth[8] + [7, 0]
    cv2.circle(hand, tuple(np.rint(place).astype(int).tolist()), 16, 150, -1)
    corners = detect_board(cv2.GaussianBlur(hand, (0, 0), 0.6), board)
    assert 8 not in corners.ids
    assert len(truth) - 4 <= len(corners) < len(truth)
    assert errors(corners, truth).max() < 0.15


def test_a_part_whose_place_the_sheet_shows_has_its_ids(slanted):
    """The image ends on one side; on the other three the sheet's margin shows where the board ends."""
    board, image, truth = slanted
    cut = int(np.sort(truth[:, 0])[len(truth) // 5]) + 12
    corners = detect_board(np.ascontiguousarray(image[:, cut:]), board)
    assert 0.6 * len(truth) < len(corners) < len(truth)
    assert not corners.ambiguous_offset
    there = truth - [cut, 0]
    ends = [there] if board.orientable else [there, there[::-1]]
    assert min(errors(corners, t).max() for t in ends) < 0.15


def test_another_grid_is_refused_with_the_reason(slanted):
    board, image, _ = slanted
    smaller = CircleGrid(board.columns, board.rows - 2, board.asymmetric, board.diameter)
    found = detect_board(image, smaller)
    assert found.larger_board
    assert "larger" in found.reason
    larger = CircleGrid(board.columns + 1, board.rows, board.asymmetric, board.diameter)
    assert "cannot be determined" in detect_board(image, larger).reason
    thinner = CircleGrid(board.columns, board.rows, board.asymmetric, 0.7 * board.diameter)
    reason = detect_board(image, thinner).reason
    assert "of their spacing" in reason
    said = parse_board(reason.split("give ")[1].split()[0])
    assert said.diameter == pytest.approx(board.diameter, rel=0.04)
    assert detect_board(image, said).found


@pytest.mark.parametrize("asked", ["circles:9x9", "circles:5x5:asymmetric", "circles:14x14"])
def test_the_other_kind_of_grid_is_named(slanted, asked):
    board, image, _ = slanted
    asked = parse_board(asked)
    reason = detect_board(image, asked).reason
    if asked.asymmetric == board.asymmetric:
        assert reason
    else:
        assert f"arranged as on circles:{board.columns}x{board.rows}" in reason
        assert ("asymmetric" in reason.split(",")[0]) == board.asymmetric


def test_noise_darkness_and_blur(slanted):
    board, image, truth = slanted
    noisy = cv2.add(image, np.random.default_rng(1).normal(0, 10, image.shape), dtype=cv2.CV_8U)
    dark = (0.12 * image + 4).astype(np.uint8)
    blurred = cv2.GaussianBlur(image, (0, 0), 2.0)
    for spoilt in (noisy, dark, blurred):
        corners = detect_board(spoilt, board)
        assert len(corners) >= 0.95 * len(truth)
        assert errors(corners, truth).max() < 0.4


def test_weights_follow_the_noise(slanted):
    board, image, _ = slanted
    noisy = cv2.add(image, np.random.default_rng(1).normal(0, 15, image.shape), dtype=cv2.CV_8U)
    assert detect_board(noisy, board).weights.mean() < 0.8 * detect_board(image, board).weights.mean()


def test_large_photographs():
    """Circles of 100 px are found in a reduced image and measured at full size."""
    pose = pose_of(SYMMETRIC, turned(15, 10, 3), 7.5)
    image, _ = take(LENS, SYMMETRIC, pose, sensor=Sensor(blur=0.7))
    big = cv2.resize(image, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    truth = (centroids(LENS, SYMMETRIC, pose) + 0.5) * 4 - 0.5
    corners = detect_board(big, SYMMETRIC)
    assert len(corners) == 35
    assert min(errors(corners, t).max() for t in (truth, truth[::-1])) < 0.2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("circles:7", "write circles as"),
        ("circles:4x11:skewed", "write circles as"),
        ("circles:2x5", "between 3x3 and"),
        ("circles:7x5:1.2", "do not touch"),
    ],
)
def test_descriptions_that_cannot_be(text, words):
    with pytest.raises(BoardError, match=words):
        parse_board(text)


@pytest.mark.parametrize("text", ["circles:7x5", "circles:4x11:asymmetric", "circles:7x5:0.6"])
def test_descriptions_are_read_back(text):
    assert parse_board(text).spec == text


def test_orientation_and_places():
    assert not SYMMETRIC.orientable
    assert ASYMMETRIC.orientable
    assert not CircleGrid(4, 10, asymmetric=True).orientable
    assert lattice(ASYMMETRIC)[[0, 1, 4, 5, 8]].tolist() == [[0, 0], [2, 0], [1, 1], [3, 1], [0, 2]]
