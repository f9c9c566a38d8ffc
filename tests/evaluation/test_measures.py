"""The measures on cases whose answer is known."""

import dataclasses

import numpy as np
import pytest

from pinholify.board import Checkerboard, lattice
from pinholify.corners import Corners, CornerSet
from pinholify.evaluation.baseline import BoardPoints, fit_opencv
from pinholify.evaluation.heldout import alternating_split, by_size
from pinholify.evaluation.measures import (
    board_lines,
    collinearity_errors,
    line_feet,
    mean_spacing,
    pinhole_lines,
    plane_crossings,
)
from pinholify.evaluation.summary import evaluate
from pinholify.pipeline import calibrate
from synthetic import SIZE, board_poses, corner_set, project

LATTICE = lattice(Checkerboard(15, 9))


def test_a_board_has_as_many_lines_as_rows_and_columns():
    assert [len(line) for line in board_lines(LATTICE, LATTICE)] == [15] * 9 + [9] * 15
    seen = LATTICE[(LATTICE[:, 0] < 2) | (LATTICE[:, 1] < 1)]
    assert sorted(len(line) for line in board_lines(seen, seen)) == [9, 9, 15]


def test_the_feet_of_points_lie_on_their_line():
    feet = np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 4.0], [3.0, 6.0]])
    points = feet + np.array([[0.2, -0.1], [-0.2, 0.1], [-0.2, 0.1], [0.2, -0.1]])
    np.testing.assert_allclose(line_feet(points), feet, atol=1e-12)


def test_lines_cross_the_plane_of_the_origin():
    anchors, directions = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 5.0]]), np.array([[1.0, 0.0, 1.0], [0.0, 0.0, -2.0]])
    np.testing.assert_allclose(plane_crossings(anchors, directions), [[-2.0, 2.0, 0.0], [0.0, 0.0, 0.0]])


def test_collinearity_of_one_point_off_its_line():
    """Three points, the middle one off by d: deviations d/3, 2d/3, d/3, so RMS d √2/3 over a length of 2."""
    points = np.array([[0.0, 0.0], [1.0, 0.003], [2.0, 0.0]])
    error = collinearity_errors(np.array([[0, 0], [1, 0], [2, 0]]), points)
    assert error == pytest.approx(0.003 * np.sqrt(2) / 3 / 2, rel=1e-4)


def test_collinearity_does_not_depend_on_place_turn_or_scale():
    rng = np.random.default_rng(0)
    points = LATTICE + 0.01 * rng.normal(size=LATTICE.shape)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    moved = 7 * points @ turn + 3
    np.testing.assert_allclose(collinearity_errors(LATTICE, points), collinearity_errors(LATTICE, moved))


def test_spacing_is_the_mean_of_both_directions():
    assert mean_spacing(LATTICE, LATTICE * [2.0, 1.0]) == pytest.approx((9 * 14 * 2 + 15 * 8) / (9 * 14 + 15 * 8))


def test_held_out_boards_are_every_second_by_size(barrel_set):
    split = alternating_split(barrel_set, barrel_set.views)
    order = [v.name for v in by_size(barrel_set.views)]
    assert order[0] == "view0.png"
    assert [v.name for v in split.train.views] == [order[i] for i in (0, 1, 3, 5, 7)]
    assert len(split.test) == 4


def test_an_evaluation_says_what_is_true(barrel_set, barrel_calibration):
    evaluation = evaluate(
        barrel_calibration,
        barrel_set,
        recalibrate=lambda part, name: calibrate(part, reference=name, method="one-image", trend="lens:3"),
        kfold=True,
    )
    floor = 0.1 * np.sqrt(2)
    assert evaluation.pooled.re_px == pytest.approx(floor, rel=0.1)
    assert evaluation.heldout_px == pytest.approx(floor, rel=0.1)
    assert evaluation.kfold_px == pytest.approx(floor, rel=0.1)
    assert evaluation.opencv["opencv8"].insample_px == pytest.approx(floor, rel=0.1)
    assert evaluation.opencv["opencv8"].heldout_px == pytest.approx(floor, rel=0.1)
    assert 0 < evaluation.pinholeness < 2e-3
    assert evaluation.pooled.re_refined_percent <= evaluation.pooled.re_percent
    assert all(b.used and b.inside == 135 for b in evaluation.boards)


def test_too_few_boards_to_hold_out_are_said(barrel_set, barrel_calibration):
    few = barrel_set.with_views(barrel_set.views[:3])
    evaluation = evaluate(
        barrel_calibration,
        few,
        recalibrate=lambda part, name: calibrate(part, reference=name, method="one-image", trend="lens:3"),
    )
    assert evaluation.heldout_px is None
    assert "half of the boards" in evaluation.heldout.reason


def test_lines_of_a_pinhole_meet_at_the_origin():
    corners = corner_set(noise=1e-9)
    calibration = calibrate(corners, reference="view0.png", method="one-image", trend="homography")
    observed = evaluate(calibration, corners, compare_opencv=False).observed
    lines = pinhole_lines(calibration.camera, list(observed.values()))
    assert len(lines.distances) == 100
    assert lines.distances.max() < 1e-6


@pytest.mark.parametrize("model", ["opencv5", "opencv8", "fisheye"])
def test_opencv_is_fitted_and_relocated(barrel_set, model):
    boards = [BoardPoints(v.lattice(barrel_set.board), v.uv) for v in barrel_set.views]
    camera = fit_opencv(model, boards, barrel_set.image_size)
    residual = camera.residuals(boards[4])
    assert np.sqrt((residual**2).sum(axis=1).mean()) < 0.3


def test_opencv_that_cannot_be_fitted_is_none(barrel_set):
    one = [BoardPoints(np.zeros((4, 2)), np.zeros((4, 2)))]
    assert fit_opencv("opencv8", one, barrel_set.image_size) is None


@pytest.mark.parametrize("board", [Checkerboard(18, 11), Checkerboard(10, 7)])
def test_photographs_of_another_board_are_scored_with_that_board(barrel_calibration, board):
    rng, points = np.random.default_rng(2), lattice(board)
    middle = points.mean(axis=0)
    views = []
    for i, (rotation, translation) in enumerate(board_poses(7, 3)[1:]):
        centre = rotation[:, :2] @ (LATTICE.mean(axis=0) - middle) + translation
        uv = project(points @ rotation[:, :2].T + centre, 0.15)
        views.append(Corners(f"other{i}.png", np.arange(len(points)), uv + 0.1 * rng.normal(size=uv.shape)))
    evaluation = evaluate(barrel_calibration, CornerSet(board, SIZE, tuple(views)))
    assert evaluation.heldout_px == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    assert evaluation.opencv["opencv8"].heldout_px == pytest.approx(0.1 * np.sqrt(2), rel=0.15)
    assert evaluation.pooled.re_px == pytest.approx(0.1 * np.sqrt(2), rel=0.1)


def test_photographs_the_camera_was_not_made_from_are_scored_with_it_as_it_is(barrel_calibration):
    """No calibration is made anew: the camera and OpenCV's models, trained on its photographs, meet new ones."""
    same_names = corner_set(squeeze=0.15, seed=7)
    fresh = same_names.with_views(dataclasses.replace(v, name=f"fresh-{v.name}") for v in same_names.views)
    evaluation = evaluate(barrel_calibration, fresh)
    floor = 0.1 * np.sqrt(2)
    assert evaluation.heldout_px == pytest.approx(floor, rel=0.1)
    assert evaluation.opencv["opencv8"].heldout_px == pytest.approx(floor, rel=0.15)
