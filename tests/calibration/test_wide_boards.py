"""Boards that reach beyond what one plane can hold: a lens of 200°."""

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.board import Checkerboard, lattice
from pinholify.calibration.observation import observe
from pinholify.corners import Corners, CornerSet
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
