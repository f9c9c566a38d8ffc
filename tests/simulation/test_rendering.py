"""The renderer against geometry that can be written down, and its corners against an outside detector."""

import cv2
import numpy as np
import pytest

from pinholify.board import Checkerboard
from pinholify.geometry import Pose
from pinholify.simulation import views
from pinholify.simulation.lenses import LENSES, BrownConrady, Lens, Pinhole
from pinholify.simulation.photograph import Sensor, photograph, through_jpeg
from pinholify.simulation.rendering import golden_lattice, pixel_rays, render
from pinholify.simulation.scene import CheckerboardTexture, Picture, Scene, TexturedPlane, cloudy, plain
from pinholify.simulation.views import board_poses, true_corners

FACING = np.eye(3)


def turned(degrees: float) -> np.ndarray:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def half_plane(xy: np.ndarray) -> np.ndarray:
    return np.where(xy[:, :1] > 0, 1.0, 0.0)


def test_an_empty_scene_is_its_background() -> None:
    rays = pixel_rays(Pinhole((32, 24), 30.0))
    assert (render(rays, Scene((), plain(0.25))) == 0.25).all()
    assert render(rays, Scene((), plain(0.25, 0.5, 1.0))).shape == (24, 32, 3)


@pytest.mark.parametrize("angle", [0.0, 1.0, 17.0, 45.0])
@pytest.mark.parametrize("shift", [0.0, 0.3, 0.77])
def test_an_edge_lies_where_geometry_puts_it(angle: float, shift: float) -> None:
    """Each row's light says where the edge crosses it; the mean over all rows is right to 0.01 px."""
    lens = Pinhole((81, 61), 100.0)
    plane = TexturedPlane(Pose(turned(angle), [shift / 10, 0, 10]), half_plane)
    image = render(pixel_rays(lens), Scene((plane,), plain(0)))
    edge = 81 - image.sum(axis=1, dtype=float) - 0.5
    truth = 40 + shift - np.tan(np.deg2rad(angle)) * (np.arange(61) - 30)
    inside = (truth > 2) & (truth < 78)
    assert abs((edge - truth)[inside].mean()) < 0.01
    assert np.abs(edge - truth)[inside].max() < 0.05


def test_sub_rays_pass_where_the_lens_says() -> None:
    """To 1e-3 px; the bend within a pixel is larger only where rays graze a mirror's rim."""
    for name in ("unity-barrel", "windscreen", "water", "mirror"):
        lens = LENSES[name]
        width, height = lens.size
        pixels = np.random.default_rng(0).integers(0, width * height, 400)
        uv = np.stack([pixels % width, pixels // width], axis=1)
        offset = np.array([[0.3, -0.45]])
        exact = lens.unproject(uv + offset)
        (near,) = pixel_rays(lens).around(pixels, offset)
        seen = [lens.project(rays.origins + 10 * rays.directions) for rays in (near, exact)]
        miss = seen[0] - seen[1]
        assert np.nanmax(np.abs(miss)) < (0.05 if name == "mirror" else 1e-3)
        assert np.nanmedian(np.abs(miss)) < 2e-4


@pytest.mark.parametrize("name", ["unity-barrel", "brown-conrady", "windscreen", "mirror"])
def test_corners_found_in_a_clean_picture_have_no_bias(name: str) -> None:
    """OpenCV's refinement, started at the truth, stays there: mean error below 0.01 px on both axes."""
    lens, board = LENSES[name], Checkerboard(9, 6)
    rays = pixel_rays(lens)
    errors = []
    for pose in board_poses([lens], board, 4, seed=2, margin=0.03, tilt=25.0)[1:]:
        scene = Scene((TexturedPlane(pose, CheckerboardTexture(board)),), plain(0.4))
        image = photograph(render(rays, scene), Sensor(blur=0.8))
        truth = true_corners(lens, board, pose).astype(np.float32)
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
        errors.append(cv2.cornerSubPix(image, truth[:, None].copy(), (5, 5), (-1, -1), stop)[:, 0] - truth)
    error = np.concatenate(errors)
    assert np.abs(error.mean(axis=0)).max() < 0.01
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.05


def test_a_pixels_light_is_the_mean_over_its_area() -> None:
    """A checkerboard of squares finer than a pixel is grey, and not a moiré."""
    texture = CheckerboardTexture(Checkerboard(900, 900), dark=0, light=1)
    scene = Scene((TexturedPlane(Pose(turned(20), [-150, -450, 200]), texture),), plain(0.5))
    image = render(pixel_rays(Pinhole((64, 48), 82.0)), scene)
    assert image.mean() == pytest.approx(0.5, abs=0.01)
    assert image.std() < 0.05


def test_the_nearer_plane_hides_the_farther() -> None:
    def red(xy: np.ndarray) -> np.ndarray:
        return np.where(np.abs(xy[:, :1]) < 1, [[1.0, 0.0, 0.0]], np.nan)

    def blue(xy: np.ndarray) -> np.ndarray:
        return np.tile([0.0, 0.0, 1.0], (len(xy), 1))

    planes = (TexturedPlane(Pose(FACING, [0, 0, 2]), red), TexturedPlane(Pose(FACING, [0, 0, 5]), blue))
    for order in (planes, planes[::-1]):
        image = render(pixel_rays(Pinhole((41, 31), 10.0)), Scene(order, plain(0, 1, 0)))
        assert (image[15, 20] == [1, 0, 0]).all()
        assert (image[15, 2] == [0, 0, 1]).all()


def test_planes_behind_the_camera_are_not_seen() -> None:
    scene = Scene((TexturedPlane(Pose(FACING, [0, 0, -2]), half_plane),), plain(0.3))
    assert (render(pixel_rays(Pinhole((20, 10), 10.0)), scene) == np.float32(0.3)).all()


def test_pixels_that_see_nothing_are_black() -> None:
    lens = BrownConrady((200, 150), (60.0, 60.0), radial=(-0.3, 0.0, 0.0))
    image = render(pixel_rays(lens), Scene((), cloudy(0.5)))
    assert image[0, 0] == 0
    assert image[75, 100] > 0.3


def test_the_board_is_drawn_on_its_lattice() -> None:
    texture = CheckerboardTexture(Checkerboard(4, 3), margin=0.5, dark=0.0, light=1.0)
    inside = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [3.5, 2.5]]
    around = [[-1.2, 0.0], [4.2, 1.0], [4.6, 1.0], [0.0, 3.4]]
    colour = texture(np.array(inside + around))[:, 0]
    assert colour[:6].tolist() == [0, 1, 0, 1, 1, 1]
    assert np.isnan(colour[6])
    assert colour[7] == 1


def test_a_picture_keeps_its_pixels() -> None:
    pixels = np.random.default_rng(0).random((5, 7, 3)).astype(np.float32)
    picture = Picture(pixels, per_unit=2.0, origin=(1.0, -1.0))
    v, u = np.mgrid[0:5, 0:7].reshape(2, -1)
    assert np.allclose(picture(np.stack([u, v], axis=1) / 2 + [1.0, -1.0]), pixels.reshape(-1, 3))
    between = picture(np.array([[1.25, -1.0], [1.25, -0.75]]))
    assert np.allclose(between, [pixels[0, :2].mean(axis=0), pixels[:2, :2].mean(axis=(0, 1))])
    assert np.isnan(picture(np.array([[0.9, 0.0], [1.0, 1.1]]))).all()


def test_a_charuco_board_as_a_picture() -> None:
    """Drawn by OpenCV, rendered as a picture on a plane, found by OpenCV where the lens images its lattice."""
    columns, rows, square = 8, 6, 60
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    target = cv2.aruco.CharucoBoard((columns, rows), 1.0, 0.7, dictionary)
    drawn = target.generateImage((columns * square, rows * square)).astype(np.float32)[:, :, None] / 255
    # The drawing's outer edge, half a pixel before its first pixel's centre, is one square before corner (0, 0).
    half_pixel = 0.5 / square
    picture = Picture(drawn, square, (half_pixel - 1, half_pixel - 1))
    lens, board = LENSES["unity-barrel"], Checkerboard(columns - 1, rows - 1)
    pose = board_poses([lens], board, 1, seed=5, margin=0.07)[0]
    image = photograph(render(pixel_rays(lens), Scene((TexturedPlane(pose, picture),), plain(1.0))), Sensor(blur=0.7))
    found, ids, *_ = cv2.aruco.CharucoDetector(target).detectBoard(image)
    # OpenCV 4 reports ChArUco corners half a pixel off; its refinement of single corners does not in any version.
    found = cv2.cornerSubPix(image, found - (0.5 if cv2.__version__ < "5" else 0.0), (5, 5), (-1, -1), (3, 60, 1e-4))
    truth = true_corners(lens, board, pose)[ids.ravel()]
    assert len(ids) == (columns - 1) * (rows - 1)
    assert np.abs((found.reshape(-1, 2) - truth).mean(axis=0)).max() < 0.02


@pytest.mark.parametrize("count", [13, 31, 53])
def test_the_lattice_resolves_both_axes(count: int) -> None:
    steps = (np.arange(count) + 0.5) / count
    assert np.allclose(np.sort(golden_lattice(count), axis=0), steps[:, None])


def flat(level: float, shape: tuple[int, ...] = (200, 300)) -> np.ndarray:
    return np.full(shape, level, np.float32)


def test_a_photograph_is_its_seeds_alone() -> None:
    sensor = Sensor(shot_noise=3.0, read_noise=2.0, jpeg_quality=85)
    first, again, other = (photograph(flat(0.5), sensor, seed) for seed in ((1, 2), (1, 2), (1, 3)))
    assert (first == again).all()
    assert (first != other).any()


def test_noise_grows_with_the_light() -> None:
    sensor = Sensor(blur=0.0, shot_noise=6.0, read_noise=4.0)
    for level in (0.1, 0.5, 0.8):
        values = photograph(flat(level, (1000, 1000)), sensor, 5).astype(float)
        assert values.mean() == pytest.approx(255 * level, abs=0.05)
        assert values.var() == pytest.approx(16 + 36 * level + 1 / 12, rel=0.01)


def test_vignetting_takes_its_share_from_the_corners() -> None:
    image = photograph(flat(1.0, (201, 301)), Sensor(blur=0.0, vignetting=0.4))
    assert image[100, 150] == 255
    assert image[0, 0] == image[-1, -1] == round(255 * 0.6)
    assert image[100, 0] == round(255 * 0.8)


def test_blur_has_its_width() -> None:
    point = np.zeros((41, 41), np.float32)
    point[20, 20] = 1
    spread = photograph(point * 8, Sensor(blur=1.5)).astype(float)
    offset = np.arange(41) - 20
    assert np.sqrt((spread.sum(axis=0) * offset**2).sum() / spread.sum()) == pytest.approx(1.5, rel=0.02)


def test_jpeg_is_lossy_and_keeps_shape_and_colour() -> None:
    grey = np.random.default_rng(0).integers(0, 256, (40, 50), dtype=np.uint8)
    assert through_jpeg(grey, 50).shape == (40, 50)
    assert (through_jpeg(grey, 50) != grey).any()
    red = np.zeros((16, 16, 3), np.uint8) + np.array([250, 5, 5], np.uint8)
    assert np.abs(through_jpeg(red, 95).astype(int) - red).max() < 8


def see(lens: Lens, board: Checkerboard, pose: Pose) -> np.ndarray:
    return true_corners(lens, board, pose)


def test_steep_poses_still_show_the_front() -> None:
    lens, board = LENSES["fisheye"], Checkerboard(8, 5)
    for pose in board_poses([lens], board, 30, seed=1, margin=1e-4, tilt=110.0):
        assert (lens.unproject(see(lens, board, pose)).directions @ pose.rotation[:, 2]).min() > 0.09


@pytest.mark.parametrize("name", ["unity-pincushion", "fisheye", "water", "mirror", "fisheye-mirror"])
def test_poses_show_the_whole_board_from_its_front(name: str) -> None:
    lens, board = LENSES[name], Checkerboard(8, 5)
    poses = board_poses([lens], board, 6, seed=3)
    for pose in poses:
        uv = see(lens, board, pose)
        assert (uv > 0.01 * lens.size[0]).all()
        assert (uv < np.array(lens.size) - 0.01 * lens.size[0]).all()
        rays = lens.unproject(uv)
        assert (rays.directions @ pose.rotation[:, 2] > 0).all()
        assert np.linalg.det(pose.rotation) == pytest.approx(1)
    areas = [np.prod(np.ptp(see(lens, board, pose), axis=0)) for pose in poses]
    assert areas[0] == max(areas)


def test_a_mirror_reverses_the_board_and_a_lens_does_not() -> None:
    for name, sign in (("fisheye", 1), ("mirror", -1)):
        board = Checkerboard(8, 5)
        uv = see(LENSES[name], board, board_poses([LENSES[name]], board, 1, seed=3)[0]).reshape(5, 8, 2)
        right, down = uv[2, 4] - uv[2, 3], uv[3, 3] - uv[2, 3]
        assert np.sign(right[0] * down[1] - right[1] * down[0]) == sign


def test_poses_fit_all_lenses_and_come_from_the_seed() -> None:
    lenses, board = [LENSES["unity-barrel"], LENSES["unity-pincushion"]], Checkerboard(8, 5)
    poses, again = (board_poses(lenses, board, 4, seed=7) for _ in range(2))
    assert all((p.rotation == q.rotation).all() for p, q in zip(poses, again, strict=True))
    assert all(np.isfinite(see(lens, board, pose)).all() for lens in lenses for pose in poses)


def test_no_room_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(views, "MAX_TRIES", 50)
    with pytest.raises(ValueError, match="poses were found that fit"):
        board_poses([Pinhole((64, 48), 60.0)], Checkerboard(60, 30), 2, seed=0, margin=0.0155)
    with pytest.raises(ValueError, match="no distance"):
        board_poses([Pinhole((64, 48), 60.0)], Checkerboard(60, 30), 2, seed=0, margin=0.1)
