"""Boards that reach beyond what one plane can hold: a lens of 200°."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.board import Checkerboard, lattice
from pinholify.calibration.observation import estimate_pose, observe, sighting_of
from pinholify.calibration.poses import Sighting, pose_residuals
from pinholify.charts import AngleChart, Intrinsics
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CalibrationError
from pinholify.geometry import Pose
from pinholify.pipeline import calibrate
from pinholify.simulation.lenses import LENSES
from pinholify.simulation.views import board_poses, true_corners

BOARD = Checkerboard(9, 6)
LENS = LENSES["fisheye"]
MIDDLE = np.array([*lattice(BOARD).mean(axis=0), 0.0])


def facing(pixel, distance):
    """The pose of a board that looks at the camera from where ``pixel`` is."""
    _, direction = LENS.unproject(np.array([pixel]))
    turn, _ = Rotation.align_vectors(direction, [[0.0, 0.0, 1.0]])
    return Pose(turn.as_matrix(), distance * direction[0] - turn.apply(MIDDLE))


def seen(name, pose, rng):
    uv = true_corners(LENS, BOARD, pose)
    return Corners(name, np.arange(len(uv)), uv + rng.normal(0.0, 0.1, uv.shape))


def test_a_board_beyond_90_degrees_counts_for_the_map_and_not_for_the_plane():
    rng = np.random.default_rng(0)
    views = [seen(f"view{i:02d}", pose, rng) for i, pose in enumerate(board_poses([LENS], BOARD, 14, seed=1))]
    views += [seen(f"corner{i}", facing(pixel, 35.0), rng) for i, pixel in enumerate([(80, 60), (1200, 900)])]
    beyond = LENS.unproject(views[-2].uv)[1][:, 2] < 0
    assert 0.1 < beyond.mean() < 0.9
    corners = CornerSet(BOARD, LENS.size, tuple(views))
    camera = calibrate(corners, reference="view00", method="joint").camera
    boards = {board.name: board for board in observe(camera, corners)[0]}
    assert boards["view05"].used
    assert not boards["corner0"].used
    assert "where the camera is valid" in boards["corner0"].reason
    rays = camera.to_rays(views[-2].uv).directions
    truth = LENS.unproject(views[-2].uv)[1]
    turn, _ = Rotation.align_vectors(truth, rays)
    assert np.degrees(np.linalg.norm(turn.apply(rays) - truth, axis=1)).max() < 0.2


LARGE = lattice(Checkerboard(30, 20))
CHART = AngleChart(np.eye(3), Intrinsics(1.0, 0.0, 0.0))
FOCAL = 500.0  # px per radian
NOISE_PX = 0.4


def around_the_camera(rng):
    """The pose of a large board that the camera nearly touches: it spans more than 90° to one side of its mean ray."""
    while True:
        turn = Rotation.from_euler("xyz", [*rng.uniform(-50, 50, 2), rng.uniform(-180, 180)], degrees=True)
        aim = turn.apply(np.append(LARGE.mean(axis=0) + rng.uniform(-12, 12, 2), 0.0))
        pose = Pose(turn.as_matrix(), [0.0, 0.0, rng.uniform(0.5, 2.0)] - aim)
        rays = pose.apply(LARGE)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        far = (rays @ rays.mean(axis=0)).min() < 0.0 and rays[:, 2].min() > np.cos(np.deg2rad(150.0))
        if far and pose.rotation[:, 2] @ pose.translation > 0.3:
            return pose


def sighted(pose, rng):
    q = CHART.coordinates(pose.apply(LARGE))
    whitening = np.broadcast_to(FOCAL * np.eye(2), (len(LARGE), 2, 2))
    return Sighting(LARGE, q + rng.normal(0.0, NOISE_PX / FOCAL, q.shape), whitening)


def rms_at(seen, pose):
    return float(np.sqrt((pose_residuals(seen, pose, CHART)[0] ** 2).mean()))


def test_the_pose_of_a_board_around_the_camera_is_found():
    rng = np.random.default_rng(0)
    for _ in range(30):
        true = around_the_camera(rng)
        seen = sighted(true, rng)
        found, _ = estimate_pose(SimpleNamespace(chart=CHART), seen)
        assert rms_at(seen, found) <= rms_at(seen, true) == pytest.approx(NOISE_PX, rel=0.1)


class Folded:
    """A map whose Jacobian is singular at the first pixels."""

    def __init__(self, count):
        self.count = count

    def value(self, uv):
        return uv / FOCAL

    def jacobian(self, uv):
        slopes = np.tile(np.eye(2) / FOCAL, (len(uv), 1, 1))
        slopes[: self.count] = [[1.0, 2.0], [2.0, 4.0]]
        return slopes


def test_points_where_the_map_is_not_one_to_one_do_not_count_for_a_pose():
    rng = np.random.default_rng(1)
    pose = Pose(np.eye(3), np.array([-14.0, -9.0, 20.0]))
    uv = FOCAL * CHART.coordinates(pose.apply(LARGE)) + rng.normal(0.0, NOISE_PX, (len(LARGE), 2))
    camera = SimpleNamespace(chart=CHART, plane_map=Folded(7))
    seen = sighting_of(camera, LARGE, uv)
    found, covariance = estimate_pose(camera, seen)
    rest = Sighting(LARGE[7:], seen.coordinates[7:], np.broadcast_to(FOCAL * np.eye(2), (len(LARGE) - 7, 2, 2)))
    expected, std = estimate_pose(camera, rest)
    np.testing.assert_allclose(found.translation, expected.translation, rtol=1e-9)
    np.testing.assert_allclose(covariance, std, rtol=1e-9)
    assert np.isnan(pose_residuals(seen, found, CHART)[0][:14]).all()
    with pytest.raises(CalibrationError, match="a pose needs 4 points whose pixels have rays, and 3 of 600 do"):
        estimate_pose(camera, sighting_of(SimpleNamespace(plane_map=Folded(597)), LARGE, uv))
