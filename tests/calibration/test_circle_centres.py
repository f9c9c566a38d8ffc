"""Centroids of discs' images, and the images of their centres: the bias is real, and goes."""

from dataclasses import replace

import numpy as np
import pytest

from pinholify.board import Checkerboard, CircleGrid, lattice
from pinholify.calibration.circles import centred, centroids_inside, local_centres, needs_centres, true_centres
from pinholify.corners import Corners, CornerSet
from pinholify.evaluation.summary import evaluate
from pinholify.geometry import apply_homography
from pinholify.io.camera_file import read_camera, write_camera
from pinholify.pipeline import calibrate
from pinholify.simulation.lenses import LENSES
from pinholify.simulation.views import board_poses, true_corners, virtual_camera

NOISE = 0.03  # px per axis


def centroids(lens, board, pose):
    """Where ``lens`` images the discs: the centroids of many points of each, weighted by their area in the image."""
    angle = np.arange(180) * np.pi / 90
    ring = board.diameter / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline = (lattice(board)[:, None] + ring).reshape(-1, 2)
    return centroids_inside(lens.project(pose.apply(outline)).reshape(-1, 180, 2))


def seen(name, board, count, *, seed=5):
    """Centroids with noise, the true images of the centres, and the true f, uc, vc of the first view's board."""
    lens, rng = LENSES[name], np.random.default_rng(1)
    poses = board_poses([lens], board, count, seed=seed, margin=0.03, tilt=45.0)
    views = []
    for i, pose in enumerate(poses):
        uv = centroids(lens, board, pose)
        views.append(Corners(f"{i}.png", np.arange(len(uv)), uv + NOISE * rng.normal(size=uv.shape)))
    truth = [true_corners(lens, board, pose) for pose in poses]
    return CornerSet(board, lens.size, tuple(views)), truth, np.array(virtual_camera(poses[0]))


def rms(corner_set, truth):
    squares = [((v.uv - t) ** 2).sum(axis=1).mean() for v, t in zip(corner_set.views, truth, strict=True)]
    return np.sqrt(np.mean(squares))


def errors(calibration, truth):
    intrinsics = calibration.camera.intrinsics
    return np.array([intrinsics.f, intrinsics.uc, intrinsics.vc]) - truth


def test_the_centroid_of_an_ellipse_is_its_centre():
    """A homography takes a circle to an ellipse, whose centre comes from its conic (Hartley & Zisserman, 2004)."""
    h = np.array([[50.0, 4, 100], [-3, 45, 80], [0.05, 0.03, 1]])
    angle = np.arange(16) * np.pi / 8
    ring = np.array([2.0, 1.0]) + 0.3 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inverse = np.linalg.inv(h)
    circle = np.array([[1, 0, -2], [0, 1, -1], [-2, -1, 5 - 0.09]])
    conic = inverse.T @ circle @ inverse
    centre = -np.linalg.solve(conic[:2, :2], conic[:2, 2])
    np.testing.assert_allclose(centroids_inside(apply_homography(h, ring)[None])[0], centre, atol=1e-9)
    assert np.linalg.norm(centre - apply_homography(h, np.array([[2.0, 1.0]]))[0]) > 0.05


def test_centroids_through_bent_maps_from_few_points():
    """Triangles of a dense outline, summed, are the witness."""
    middle = np.array([[3.0, 1.0], [-2.0, 4.0]])

    def outlines(count):
        angle = np.arange(count) * (2 * np.pi / count)
        x, y = (middle[:, None] + 0.4 * np.stack([np.cos(angle), np.sin(angle)], axis=1)).transpose(2, 0, 1)
        return np.stack([30 * np.sin(0.2 * x) + y * y, 25 * y - 0.5 * x * x * y], axis=2)

    start = outlines(4000)
    end = np.roll(start, -1, axis=1)
    twice = start[:, :, 0] * end[:, :, 1] - start[:, :, 1] * end[:, :, 0]
    dense = ((start + end) / 3 * twice[:, :, None]).sum(axis=1) / twice.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(centroids_inside(outlines(16)), dense, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "board"),
    [("pinhole", CircleGrid(9, 7)), ("fisheye", CircleGrid(9, 7)), ("unity-barrel", CircleGrid(5, 8, True, 0.8))],
)
def test_neighbours_tell_most_of_the_bias(name, board):
    corners, truth, _ = seen(name, board, 3)
    noise = 2 * NOISE**2
    before, after = rms(corners, truth) ** 2, rms(local_centres(corners), truth) ** 2
    assert before > 9 * noise
    assert after - noise < 0.4**2 * (before - noise)


@pytest.fixture(scope="module")
def pinhole():
    """Centroids, true centres, the true camera, and the calibration."""
    corners, truth, true_camera = seen("pinhole", CircleGrid(9, 7), 8)
    return corners, truth, true_camera, calibrate(corners, reference="0.png")


def test_the_bias_of_a_pinhole_goes(pinhole):
    """Left alone it moves f by many standard deviations; corrected, what is left is noise."""
    corners, truth, true_camera, calibration = pinhole
    biased = calibrate(replace(corners, centred=True), reference="0.png")
    assert abs(errors(biased, true_camera)[0] / biased.intrinsics_std[0]) > 5
    assert (np.abs(errors(calibration, true_camera)) < 3 * calibration.intrinsics_std).all()
    assert rms(corners, truth) > 0.2
    assert rms(calibration.corner_set, truth) < 1.05 * np.sqrt(2) * NOISE
    assert calibration.corner_set.centred


@pytest.mark.slow
@pytest.mark.parametrize("board", [CircleGrid(9, 7), CircleGrid(4, 11, True, 0.8)])
def test_the_bias_of_a_fisheye_goes(board):
    corners, truth, true_camera = seen("fisheye", board, 10)
    calibration = calibrate(corners, reference="0.png")
    assert (np.abs(errors(calibration, true_camera)) < 3 * calibration.intrinsics_std).all()
    assert rms(corners, truth) > 0.5
    assert rms(calibration.corner_set, truth) < 1.05 * np.sqrt(2) * NOISE


@pytest.mark.slow
def test_one_image_is_corrected_too():
    corners, truth, _ = seen("brown-conrady", CircleGrid(9, 7), 4)
    calibration = calibrate(corners, reference="0.png", method="one-image")
    assert rms(corners, truth) > 0.2
    assert rms(calibration.corner_set, truth) < 1.1 * np.sqrt(2) * NOISE


def test_corners_are_corrected_once(tmp_path, pinhole):
    """The calibration holds centres, in its file too; photographs of it that are evaluated again are the same ones."""
    corners, _, _, calibration = pinhole
    assert needs_centres(corners)
    assert centred(calibration.corner_set, calibration) is calibration.corner_set
    again = centred(corners, calibration)
    for mine, known in zip(again.views, calibration.corner_set.views, strict=True):
        assert mine.name == known.name
        assert np.array_equal(mine.uv, known.uv)
    write_camera(tmp_path / "camera.npz", calibration)
    read = read_camera(tmp_path / "camera.npz")
    assert read.corner_set.centred
    evaluation = evaluate(read, corners, compare_opencv=False)
    assert evaluation.pooled.re_px < 1.2 * np.sqrt(2) * NOISE


def test_other_boards_and_lost_views_stay_as_they_are(pinhole):
    plain = CornerSet(Checkerboard(4, 3), (640, 480), (Corners("a", np.arange(12), lattice(Checkerboard(4, 3))),))
    assert local_centres(plain) is plain
    assert not needs_centres(plain)
    corners, _, _, calibration = pinhole
    few = corners.views[3].select(np.arange(63) < 6)
    lost = corners.with_views([few])
    assert np.array_equal(true_centres(lost, calibration.camera).views[0].uv, few.uv)
    assert np.array_equal(local_centres(lost).views[0].uv, few.uv)
