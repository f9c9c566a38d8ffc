"""The simplified Zhang's method: exact cases and degenerate sets."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.calibration.zhang import pose_from_homography, simplified_zhang
from pinholify.charts import Intrinsics
from pinholify.errors import DegenerateError

K = Intrinsics(5.0, 7.2, 3.9)
PLANE = np.array([[0.25, 0, -1.75], [0, 0.25, -1.0], [0, 0, 1]])


def homography(turns, translation=(0.5, -0.3, 9.0)):
    rotation = Rotation.from_euler("xyz", turns, degrees=True).as_matrix()
    return K.matrix @ np.column_stack([rotation[:, 0], rotation[:, 1], translation])


def stack(*turns):
    return np.stack([homography(t, (0.3 * i, -0.2 * i, 9.0 + i)) for i, t in enumerate(turns)])


def test_two_tilted_boards_give_k_exactly():
    closed = simplified_zhang(stack((25, -10, 3), (-15, 20, 0)), PLANE)
    assert (closed.intrinsics.f, closed.intrinsics.uc, closed.intrinsics.vc) == pytest.approx((5.0, 7.2, 3.9), rel=1e-9)
    assert closed.singular_values[3] < 1e-10 * closed.singular_values[0]


def test_the_reference_board_among_them_says_nothing():
    """Its homography is the identity: both its equations read 0 = 0 (a slip of the paper mended)."""
    boards = stack((25, -10, 3), (-15, 20, 0))
    with_reference = np.concatenate([boards, np.eye(3)[None]])
    assert simplified_zhang(with_reference, PLANE).intrinsics.f == pytest.approx(5.0, rel=1e-9)
    with pytest.raises(DegenerateError, match="singular values"):
        simplified_zhang(np.stack([boards[0], np.eye(3)]), PLANE)


@pytest.mark.parametrize(
    "turns",
    [
        [(25, -10, 3)],
        [(0, 0, 0)] * 6,
        [(25, -10, 0)] * 6,
        [(0, 0, 0)] * 3 + [(25, -10, 0)] * 3,
    ],
    ids=["one", "parallel to the reference", "parallel to each other", "two groups, one of them the reference's"],
)
@pytest.mark.parametrize("noise", [0.0, 1e-13])
def test_degenerate_sets_are_refused(turns, noise):
    """Rounding alone; with the noise of corners the calibration judges by the error bars, see test_one_image."""
    boards = stack(*turns)
    boards = boards / boards[:, 2:, 2:] + noise * np.random.default_rng(0).normal(size=boards.shape)
    with pytest.raises(DegenerateError, match="singular values"):
        simplified_zhang(boards, PLANE)


@pytest.mark.parametrize("seed", range(8))
def test_homographies_that_contradict_each_other_are_refused(seed):
    """No K fits them: the fourth singular value is as large as the third."""
    rng = np.random.default_rng(seed)
    with pytest.raises(DegenerateError, match="stand out"):
        simplified_zhang(rng.normal(size=(6, 3, 3)), np.eye(3))


def test_two_groups_neither_parallel_to_the_reference_are_enough():
    closed = simplified_zhang(stack((25, -10, 0), (25, -10, 0), (-15, 20, 0), (-15, 20, 0)), PLANE)
    assert closed.intrinsics.f == pytest.approx(5.0, rel=1e-9)


def test_a_pose_is_recovered_whatever_the_homographys_scale_and_sign():
    h = homography((25, -10, 3))
    rotation = Rotation.from_euler("xyz", (25, -10, 3), degrees=True).as_matrix()
    for factor in (1.0, -3.7):
        pose = pose_from_homography(factor * h, K)
        np.testing.assert_allclose(pose.rotation, rotation, atol=1e-12)
        np.testing.assert_allclose(pose.translation, (0.5, -0.3, 9.0), atol=1e-12)
