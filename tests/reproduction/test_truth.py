"""Comparison with truth, on corners that are true or wrong by a known amount."""

from types import SimpleNamespace

import numpy as np
import pytest

from pinholify.board import size
from pinholify.corners import Corners, CornerSet
from pinholify.geometry import Pose, convex_hull
from pinholify.reproduction.truth import (
    corner_errors,
    exact_corners,
    heldout_floor,
    map_error,
    numbered_poses,
    relative,
)
from pinholify.simulation.datasets import DATASETS, reduced
from pinholify.simulation.views import true_corners

WEBCAM = reduced(DATASETS["webcam"], 2.0)


@pytest.fixture(scope="module")
def poses():
    return WEBCAM.poses()


def corners(poses, *, noise=0.0, shift=(0.0, 0.0), turned=()):
    """The corners of all boards, those of index ``turned`` numbered from the other end."""
    rng, ids = np.random.default_rng(0), np.arange(size(WEBCAM.board))
    views = []
    for i, pose in enumerate(poses):
        uv = true_corners(WEBCAM.lens, WEBCAM.board, pose)
        uv = uv + shift + rng.normal(0, noise, uv.shape) if noise else uv + shift
        views.append(Corners(f"{i}.png", ids[::-1] if i in turned else ids, uv))
    return CornerSet(WEBCAM.board, WEBCAM.lens.size, tuple(views))


def test_boards_numbered_from_their_other_end_are_recognised(poses):
    found = corners(poses, turned=(2, 5))
    numbered = numbered_poses(WEBCAM, found)
    assert corner_errors(WEBCAM, found, numbered).rms_px < 1e-6
    assert np.allclose(numbered["0.png"].rotation, poses[0].rotation)
    assert np.allclose(numbered["2.png"].rotation[:, 2], poses[2].rotation[:, 2])
    assert np.allclose(numbered["2.png"].rotation[:, 0], -poses[2].rotation[:, 0])


def test_a_shift_of_all_corners_is_measured(poses):
    found = corners(poses, shift=(0.02, -0.01))
    errors = corner_errors(WEBCAM, found, numbered_poses(WEBCAM, found))
    assert errors.shift_px == pytest.approx((0.02, -0.01), abs=1e-6)
    assert errors.rms_px == pytest.approx(np.hypot(0.02, 0.01), abs=1e-6)


def test_exact_corners_keep_names_and_numbers(poses):
    found = corners(poses, noise=0.1, turned=(1,))
    exact = exact_corners(WEBCAM, found, numbered_poses(WEBCAM, found))
    for view, true, pose in zip(exact.views, found.views, poses, strict=True):
        assert view.name == true.name
        assert (view.ids == true.ids).all()
        np.testing.assert_allclose(view.uv, true_corners(WEBCAM.lens, WEBCAM.board, pose), atol=1e-6)


def test_the_true_lens_leaves_the_noise_less_what_six_numbers_a_board_take(poses):
    found = corners(poses, noise=0.1)
    floor = heldout_floor(WEBCAM.lens, found, found.views, numbered_poses(WEBCAM, found).values())
    count = size(WEBCAM.board)
    assert floor == pytest.approx(0.1 * np.sqrt(2 * (2 * count - 6) / (2 * count)), rel=0.05)
    assert heldout_floor(WEBCAM.lens, found, found.views[:1], poses) is None


def test_the_map_of_a_perfect_camera_has_no_error_and_a_shifted_one_has_the_shift(poses):
    """The true map, and one that is wrong by a known bend in px."""
    truth, reference = WEBCAM.truth(), poses[0]
    hull = convex_hull(true_corners(WEBCAM.lens, WEBCAM.board, reference))
    bend = 0.05

    def camera(amplitude):
        def virtual_points(uv):
            bent = uv + amplitude * np.sin(uv / 40.0)
            directions = WEBCAM.lens.unproject(bent).directions
            return 7.0 * directions[:, :2] / directions[:, 2:] + [3.0, 4.0]

        return SimpleNamespace(domain=SimpleNamespace(hull=hull), virtual_points=virtual_points)

    assert map_error(camera(0.0), WEBCAM.lens, truth, reference) < 1e-6
    assert map_error(camera(bend), WEBCAM.lens, truth, reference) == pytest.approx(bend, rel=0.1)


def test_relative_poses_do_not_depend_on_the_camera(poses):
    turn = Pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, 2.0, 3.0]))

    def moved(pose):
        return Pose(turn.rotation @ pose.rotation, turn.rotation @ pose.translation + turn.translation)

    before, after = relative(poses[0], poses[3]), relative(moved(poses[0]), moved(poses[3]))
    np.testing.assert_allclose(after.rotation, before.rotation, atol=1e-12)
    np.testing.assert_allclose(after.translation, before.translation, atol=1e-9)
