"""Dense corners condensed: no bias where the lattice bends, and the weights that truth confirms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.board import Checkerboard, lattice, size
from pinholify.calibration.condensing import block_side, condensed, condensed_view, predicted_by_neighbours
from pinholify.calibration.one_image import calibrate_one_image
from pinholify.corners import Corners, CornerSet
from synthetic import SIZE, project

BOARD = Checkerboard(31, 23)
EVERY = np.arange(size(BOARD))


def bent(x, y):
    """A quadratic of the lattice, px."""
    return np.stack([30 * x + 0.2 * x * y + 0.3 * x**2, 25 * y - 0.1 * y**2 + x], axis=1)


TRUTH = bent(*lattice(BOARD).T)


def test_blocks_are_as_large_as_they_must_be():
    assert [block_side(total, 100) for total in (50, 100, 101, 900, 901)] == [1, 1, 3, 3, 5]


@pytest.mark.parametrize("side", [3, 5])
def test_a_quadratic_lattice_is_condensed_without_any_error(side):
    found = condensed_view(Corners("a", EVERY, TRUTH), BOARD, side)
    assert len(found) == (31 // side + (31 % side > side // 2)) * (23 // side + (23 % side > side // 2))
    np.testing.assert_allclose(found.uv, TRUTH[found.ids], atol=1e-8)


def test_a_lattice_with_holes_is_condensed_without_any_error():
    keep = np.random.default_rng(0).uniform(size=len(EVERY)) < 0.7
    weights = np.random.default_rng(1).uniform(0.5, 2.0, len(EVERY))
    found = condensed_view(Corners("a", EVERY, TRUTH, weights).select(keep), BOARD, 3)
    assert len(found) > 40
    np.testing.assert_allclose(found.uv, TRUTH[found.ids], atol=1e-8)


def test_weights_tell_the_noise_that_is_left():
    rng = np.random.default_rng(0)
    weights = np.where(EVERY % 2, 1.0, 0.5)
    squares = []
    for _ in range(200):
        noisy = TRUTH + rng.normal(size=TRUTH.shape) / weights[:, None]
        found = condensed_view(Corners("a", EVERY, noisy, weights), BOARD, 3)
        squares.append(((found.uv - TRUTH[found.ids]) * found.weights[:, None]) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.03)
    inner = np.mean(squares, axis=(0, 2))
    assert inner.min() > 0.6
    assert inner.max() < 1.5


def test_little_is_lost():
    """Inside the board the middle of nine points of weight 1 keeps what more than five and a half know."""
    assert np.median(condensed_view(Corners("a", EVERY, TRUTH), BOARD, 3).weights) ** 2 > 5.5


def test_points_scattered_over_their_lattice_are_thinned():
    view = Corners("a", EVERY, TRUTH).select((EVERY % 31 % 3 == 0) & (EVERY // 31 % 3 == 0))
    found = condensed_view(view, BOARD, 3)
    assert len(found) == -(-len(view) // 9)
    np.testing.assert_array_equal(found.uv, TRUTH[found.ids])


def test_few_corners_stay_as_they_are():
    views = [Corners("a", EVERY, TRUTH), Corners("b", EVERY[:0], TRUTH[:0], reason="dark")]
    given = CornerSet(BOARD, SIZE, tuple(views))
    assert all(a is b for a, b in zip(condensed(given, 10_000).views, views, strict=True))
    fewer = condensed(given, 100)
    assert 50 < len(fewer.views[0]) <= 100
    assert fewer.views[1] is views[1]


def test_neighbours_predict_a_point():
    shifted = TRUTH.copy()
    shifted[40] += 5.0
    uv, variance = predicted_by_neighbours(Corners("a", EVERY, shifted), BOARD, 2)
    assert np.linalg.norm(uv[40] - TRUTH[40]) < 1e-8
    assert np.isfinite(variance).all()
    lonely = Corners("a", EVERY[:3], TRUTH[:3])
    assert np.isinf(predicted_by_neighbours(lonely, BOARD, 2)[1]).all()


def test_one_image_learns_from_a_dense_board():
    board, rng = Checkerboard(57, 33), np.random.default_rng(2)
    points = np.column_stack([lattice(board) / 4.0, np.zeros(size(board))])
    turns = [(0, 0, 0), (25, -20, 3), (-25, 15, -4), (10, 28, 2)]
    views = []
    for i, angles in enumerate(turns):
        rotation = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        place = np.array([0.0, 0.0, 9.0 if i == 0 else 16.0]) - rotation @ [7.0, 4.0, 0.0]
        uv = project(points @ rotation.T + place, squeeze=0.1)
        views.append(Corners(f"{i}.png", np.arange(size(board)), uv + rng.normal(0, 0.1, uv.shape)))
    found = calibrate_one_image(CornerSet(board, SIZE, tuple(views)), reference="0.png", trend="lens:2")
    # The lattice is four times as fine, so the virtual camera's lengths are four times as many squares.
    assert found.camera.intrinsics.f == pytest.approx(36.0, abs=0.05)
    assert found.camera.noise_px == pytest.approx(0.1, rel=0.2)
    assert abs(found.camera.intrinsics.uc - 28.0) < 0.05
