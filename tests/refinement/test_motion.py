"""Whether boards moved, from corners around the true camera."""

from dataclasses import replace

import numpy as np
import pytest

from pinholify.refinement.basis import no_basis
from pinholify.refinement.model import Model, State
from pinholify.refinement.motion import motion_of, motion_rms
from pinholify.refinement.observations import Observations, image_frame, lattice_middle, observations
from pinholify.refinement.shape import board_shape
from pinholify.refinement.solver import Loss, Solution, measured
from pinholify.refinement.trends import LensTrend, Plane

from .conftest import BOARD, FOCAL, SIZE, Scene, make_scene

FRAME = image_frame(SIZE, False)
STILL, MOVED = make_scene("pinhole", views=14), make_scene("pinhole", views=14, motion=0.01)


def around_the_truth(scene: Scene, moved: set[int]) -> tuple[Solution, Observations]:
    """The true camera and poses, and the corners of ``scene``, of the boards ``moved`` those of them that moved."""
    views = [MOVED.corners.views[i] if i in moved else view for i, view in enumerate(scene.corners.views)]
    seen = observations(views, BOARD, FRAME)
    model = Model(LensTrend(Plane(), False, 1, tangent=False), no_basis(FRAME.half_size), board_shape(BOARD))
    beta = np.zeros(len(model.trend.prior_std))
    beta[0] = FRAME.scale / FOCAL
    beta[3:5] = FRAME.normalise(np.array([401.0, 297.0]))
    middle = np.append(lattice_middle(BOARD), 0.0)
    eta = np.zeros(len(model.shape.prior_std))
    state = State.still(beta, eta, scene.rotations, scene.translations + scene.rotations @ middle)
    solution = measured(model, state, seen, model.trend_precision(), Loss(0.1 / FRAME.scale))
    assert solution is not None
    return solution, seen


def test_the_scenes_differ_by_their_motions_alone() -> None:
    np.testing.assert_array_equal(STILL.rotations, MOVED.rotations)


def test_still_boards_do_not_move() -> None:
    solution, seen = around_the_truth(STILL, set())
    assert motion_of(solution, seen) == 0.0
    assert motion_rms(solution, seen) == 0.0


@pytest.mark.filterwarnings("error")
def test_one_board_alone_does_not_move() -> None:
    solution, seen = around_the_truth(STILL, set())
    alone, one = np.arange(seen.boards) == 3, seen.select(seen.view == 3)
    model = solution.model
    found = measured(model, solution.state.of_boards(alone), one, model.trend_precision(), Loss(0.1 / FRAME.scale))
    assert found is not None
    assert motion_of(found, one) == 0.0


def test_motions_are_as_large_whatever_the_corners_weigh() -> None:
    solution, seen = around_the_truth(STILL, set())
    motions = np.random.default_rng(0).normal(0, 0.01, (seen.boards, 3))
    moving = replace(solution, state=replace(solution.state, motions=motions))
    expected = motion_rms(moving, seen)
    assert expected > 0.0
    assert motion_rms(moving, seen.weighted(np.full(seen.boards, 3.0))) == pytest.approx(expected)


@pytest.mark.parametrize("moved", [{3}, {3, 8}])
def test_few_boards_that_moved_are_no_rule(moved: set[int]) -> None:
    solution, seen = around_the_truth(STILL, moved)
    assert motion_of(solution, seen) == 0.0


def test_all_boards_that_moved_tell_how_much() -> None:
    """0.01 radians over the image's height, in noises per unit of the image."""
    solution, seen = around_the_truth(STILL, set(range(14)))
    expected = 0.01 * FRAME.scale / SIZE[1] / (0.1 / FRAME.scale)
    assert motion_of(solution, seen) == pytest.approx(expected, rel=0.3)
