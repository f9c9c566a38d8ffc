"""Boards are put into the right poses though some of their corners are wrong, or their tilts look alike."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.corners import Corners
from pinholify.refinement import refine
from pinholify.refinement.candidates import Setting
from pinholify.refinement.observations import Observations, image_frame, lattice_middle, observations
from pinholify.refinement.posing import righted, robust_poses
from pinholify.refinement.shape import board_shape
from pinholify.refinement.solver import Solution
from pinholify.refinement.spectral import density_named
from pinholify.refinement.start import first_solution

from .conftest import BOARD, SIZE, Scene, make_scene, ray_errors_px

FRAME = image_frame(SIZE, False)


def middles(scene: Scene) -> np.ndarray:
    return scene.translations + scene.rotations @ np.append(lattice_middle(BOARD), 0.0)


def angles_deg(rotations: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.degrees(Rotation.from_matrix(rotations @ truth.transpose(0, 2, 1)).magnitude())


def directions_of(scene: Scene, seen: Observations) -> np.ndarray:
    turned = np.einsum("nij,nj->ni", scene.rotations[seen.view][:, :, :2], seen.lattice)
    return turned + middles(scene)[seen.view]


def test_a_few_wrong_corners_do_not_bend_the_pose_of_their_board() -> None:
    scene = make_scene("pinhole", noise=0.0)
    seen = observations(scene.corners.views, BOARD, FRAME)
    directions = directions_of(scene, seen)
    directions[[3, 17, 60, 61, 62]] += 2.0 * np.random.default_rng(0).normal(size=(5, 3))
    rotations, translations = robust_poses(directions, seen)
    assert angles_deg(rotations, scene.rotations).max() < 0.5
    np.testing.assert_allclose(translations, middles(scene), rtol=0.01, atol=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_small_boards_with_grossly_wrong_corners_give_the_camera_that_the_others_give(seed: int) -> None:
    scene = make_scene("decentred", views=10, seed=seed)
    rng = np.random.default_rng(seed)
    views = []
    for view in scene.corners.views:
        uv = np.array(view.uv)
        off = rng.random(len(uv)) < 0.03
        uv[off] = np.clip(uv[off] + rng.normal(0, 150.0, (off.sum(), 2)), 5.0, np.array(SIZE) - 6.0)
        views.append(Corners(view.name, view.ids, uv))
    clean = refine(scene.corners, reference="view00")
    spoilt = refine(scene.corners.with_views(views), reference="view00")
    assert spoilt.noise_px == pytest.approx(0.1, rel=0.1)
    uv = np.concatenate([view.uv for view in scene.corners.views])
    errors = [ray_errors_px(scene, uv, found.camera.to_rays(uv).directions) for found in (clean, spoilt)]
    assert np.sqrt((errors[1] ** 2).mean()) < 2.0 * np.sqrt((errors[0] ** 2).mean())


@pytest.fixture(scope="module")
def started() -> tuple[Solution, Observations]:
    """A scene with the start of its joint solve."""
    seen = observations(make_scene("pinhole").corners.views, BOARD, FRAME)
    setting = Setting(*density_named("se"), board_shape(BOARD), FRAME.half_size, seen.image, 0.1)
    return first_solution(setting, seen, None)[0], seen


def test_right_poses_stay(started: tuple[Solution, Observations]) -> None:
    first, seen = started
    assert righted(first.model, first.state, seen, first.model.trend_precision()) is first.state


def test_reversed_tilts_are_righted(started: tuple[Solution, Observations]) -> None:
    first, seen = started
    rotations = np.array(first.state.rotations)
    for k in (2, 5):
        sight = first.state.translations[k] / np.linalg.norm(first.state.translations[k])
        rotations[k] = (np.eye(3) - 2.0 * np.outer(sight, sight)) @ rotations[k] @ np.diag([1.0, 1.0, -1.0])
    assert angles_deg(rotations, first.state.rotations)[[2, 5]].min() > 10.0
    state = dataclasses.replace(first.state, rotations=rotations)
    found = righted(first.model, state, seen, first.model.trend_precision())
    assert angles_deg(found.rotations, first.state.rotations).max() < 0.5


def test_a_board_in_a_wrong_pose_is_not_thought_noisy(monkeypatch: pytest.MonkeyPatch) -> None:
    """The descent is led into a wrong pose, which the solve has to leave again by itself."""
    scene = make_scene("pinhole")

    def led_astray(setting: Setting, seen: Observations, given: None) -> tuple[Solution, None]:
        first = first_solution(setting, seen, given)[0]
        rotations = np.array(first.state.rotations)
        rotations[4] = rotations[4] @ Rotation.from_euler("x", 70, degrees=True).as_matrix()
        return dataclasses.replace(first, state=dataclasses.replace(first.state, rotations=rotations)), None

    monkeypatch.setattr("pinholify.refinement.joint.first_solution", led_astray)
    result = refine(scene.corners, reference="view00")
    assert result.noise_px == pytest.approx(0.1, rel=0.05)
    assert max(result.board_noise_px.values()) < 0.2
