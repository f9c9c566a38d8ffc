"""Corners once the camera is known: finer, and those that the first look missed."""

import cv2
import numpy as np
import pytest

from pinholify.board import Checkerboard, lattice
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import Intrinsics, PlaneChart
from pinholify.corners import Corners, CornerSet, not_found
from pinholify.detection import detect_board, look_again, look_again_in_files
from pinholify.detection.second_look import expect
from pinholify.errors import ImageError
from pinholify.geometry import Pose, convex_hull
from pinholify.gp.fitting import fit_map
from pinholify.io.images import write_image
from pinholify.io.importing.adoption import adopt
from pinholify.io.importing.base import ForeignCamera
from pinholify.simulation.lenses import Fisheye
from pinholify.simulation.photograph import Sensor, photograph
from pinholify.simulation.rendering import pixel_rays, render
from pinholify.simulation.scene import CheckerboardTexture, Scene, TexturedPlane
from pinholify.simulation.views import true_corners, virtual_camera

BOARD = Checkerboard(11, 8)
LENS = Fisheye((640, 480), 210.0)
POSE = Pose(np.eye(3), np.array([-5.0, -3.5, 3.6]))
TURN = cv2.Rodrigues(np.array([0.2, -0.3, 0.04]))[0]
VIEW = Pose(TURN, np.array([0.0, 0.0, 4.6]) - TURN @ [5.0, 3.5, 0.0])


@pytest.fixture(scope="module")
def camera():
    """The lens as a dense target in the plane of POSE shows it."""
    grid = np.stack(np.meshgrid(np.linspace(-1, 11, 31), np.linspace(-1, 8, 23)), axis=-1).reshape(-1, 2)
    uv = LENS.project(POSE.apply(np.column_stack([grid, np.zeros(len(grid))])))
    uv += np.random.default_rng(0).normal(0, 0.02, uv.shape)
    fitted = fit_map(uv, grid, kernel="se", trend="lens:3")
    intrinsics = Intrinsics(*virtual_camera(POSE))
    domain = Domain(convex_hull(uv))
    return VirtualCamera(fitted.map, PlaneChart(intrinsics), domain, LENS.size, fitted.noise)


@pytest.fixture(scope="module")
def seen():
    """A strongly bent photograph of the board, and its true corners (n, 2) px."""
    scene = Scene((TexturedPlane(VIEW, CheckerboardTexture(BOARD)),), lambda rays: np.full((len(rays), 1), 0.4))
    image = photograph(render(pixel_rays(LENS), scene), Sensor(blur=0.7, read_noise=2.0), 1)
    points = lattice(BOARD)
    return image, LENS.project(VIEW.apply(np.column_stack([points, np.zeros(len(points))])))


def error(corners, truth):
    return np.linalg.norm(corners.uv - truth[corners.ids], axis=1)


def test_corners_are_finer_where_the_lens_bends_the_board(camera, seen):
    image, truth = seen
    first = detect_board(image, BOARD)
    again = look_again(image, first, BOARD, camera)
    assert np.array_equal(again.ids, np.arange(88))
    before, after = (np.sqrt((error(corners, truth) ** 2).mean()) for corners in (first, again))
    assert after < 0.97 * before


def test_missed_corners_are_found(camera, seen):
    image, truth = seen
    first = detect_board(image, BOARD, name="a.png")
    row, column = np.divmod(first.ids, 11)
    part = first.select((column > 2) & (column < 9) & (row > 1))
    again = look_again(image, part, BOARD, camera)
    assert np.array_equal(again.ids, np.arange(88))
    assert error(again, truth).max() < 0.2
    assert again.name == "a.png"


def test_hidden_corners_are_not(camera, seen):
    image, truth = seen[0].copy(), seen[1]
    rng = np.random.default_rng(5)
    hidden = np.zeros(88, dtype=bool)
    for centre in truth[[14, 38, 62, 74]] + rng.uniform(-6, 6, (4, 2)):
        cv2.circle(image, tuple(int(c) for c in np.rint(centre)), 22, int(rng.integers(40, 200)), -1)
        hidden |= np.linalg.norm(truth - centre, axis=1) < 19
    first = detect_board(image, BOARD)
    again = look_again(image, first, BOARD, camera)
    assert hidden.sum() >= 4
    assert not hidden[again.ids].any()
    assert error(again, truth).max() < 0.5  # beside a disc's rim


def test_squares_of_the_wrong_colour_are_no_corners(camera, seen):
    image, _ = seen
    first = detect_board(image, BOARD)
    part = first.select(first.ids % 11 < 6)
    flipped = image.copy()
    beyond = np.arange(640) > first.uv[first.ids % 11 == 6, 0].min() - 3
    flipped[:, beyond] = 255 - flipped[:, beyond]
    again = look_again(flipped, part, BOARD, camera)
    assert (again.ids % 11 < 6).all()


def test_another_cameras_photograph_is_left_as_it_is(camera, seen):
    image, truth = seen
    bent = (truth - 320) * (1 + 1e-5 * ((truth - 320) ** 2).sum(axis=1, keepdims=True)) + 320
    strange = Corners("a", np.arange(88), bent)
    assert look_again(image, strange, BOARD, camera) is strange
    few = strange.select(np.arange(88) < 7)
    assert look_again(image, few, BOARD, camera) is few


def test_files_are_looked_at_again(camera, seen, tmp_path):
    image, _ = seen
    write_image(tmp_path / "a.png", image)
    write_image(tmp_path / "b.png", np.full_like(image, 90))
    first = detect_board(image, BOARD, name="a.png").select(np.arange(88) % 11 > 1)
    corners = CornerSet(BOARD, (640, 480), (first, not_found("b.png", "nothing there")))
    arrived = []
    again = look_again_in_files([tmp_path / "a.png", tmp_path / "b.png"], corners, camera, on_result=arrived.append)
    assert [len(view) for view in again.views] == [88, 0]
    assert again.views[1].reason == "nothing there"
    assert arrived == list(again.views)
    with pytest.raises(ImageError, match="1280x960 px, but the camera was calibrated at 640x480"):
        look_again_in_files([], CornerSet(BOARD, (1280, 960)), camera)


def test_an_imported_camera_expects_corners_too():
    """Its noise is unknown, nan, which is no reason not to look."""
    size = LENS.size
    foreign = ForeignCamera("file", "test", "lens", LENS.project, np.full(2, 210.0), np.array(size) / 2.0, size)
    uv = true_corners(LENS, BOARD, VIEW)
    view = Corners("a", np.arange(len(uv)), uv + np.random.default_rng(0).normal(0, 0.02, uv.shape))
    expected = expect(adopt(foreign).calibration.camera, view, BOARD)
    assert expected is not None
    assert np.abs(expected.prediction.uv - uv).max() < 0.1
