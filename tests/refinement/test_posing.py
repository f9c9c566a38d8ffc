"""Boards are put into the right poses though some of their corners are wrong, or their tilts look alike."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.board import lattice
from pinholify.corners import Corners, CornerSet
from pinholify.refinement import refine
from pinholify.refinement.candidates import Setting
from pinholify.refinement.observations import Observations, image_frame, lattice_middle, observations
from pinholify.refinement.outliers import coherent
from pinholify.refinement.posing import righted
from pinholify.refinement.shape import board_shape
from pinholify.refinement.solver import Solution
from pinholify.refinement.spectral import density_named
from pinholify.refinement.start import first_solution

from .conftest import BOARD, PROJECTS, SIZE, decentred, make_scene

FRAME = image_frame(SIZE, False)


def angles_deg(rotations: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.degrees(Rotation.from_matrix(rotations @ truth.transpose(0, 2, 1)).magnitude())


def far_boards(seed: int, share: float) -> tuple[CornerSet, CornerSet]:
    """Small, distant boards with good corners, and with a ``share`` of corners off by about half a board."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([lattice(BOARD) - lattice_middle(BOARD), np.zeros(54)])
    clean: list[Corners] = []
    spoilt: list[Corners] = []
    while len(clean) < 10:
        angles = np.append(rng.normal(0, 10), rng.uniform(-40, 40, 2)) if clean else rng.normal(0, 3, 3)
        aim = rng.uniform(14, 30) * np.append(rng.uniform(-0.8, 0.8, 2) * [1, 0.6], 1)
        aim = aim if clean else np.array([0, 0, 13])
        uv = decentred(points @ Rotation.from_euler("zyx", angles, degrees=True).as_matrix().T + aim)
        if not ((uv > 3).all() and (uv < np.array(SIZE) - 4).all()):
            continue
        seen, wrong = uv + rng.normal(0, 0.1, uv.shape), rng.random(54) < share
        moved = np.clip(seen + rng.normal(0, 100, seen.shape), 5, np.array(SIZE) - 6)
        clean.append(Corners(f"view{len(clean):02d}", np.arange(54), seen))
        spoilt.append(dataclasses.replace(clean[-1], uv=np.where(wrong[:, None], moved, seen)))
    return CornerSet(BOARD, SIZE, tuple(clean)), CornerSet(BOARD, SIZE, tuple(spoilt))


@pytest.mark.parametrize(("seed", "share"), [(3, 0.01), (6, 0.01), (1, 0.03), (4, 0.03), (7, 0.03)])
def test_small_boards_with_grossly_wrong_corners_give_the_camera_that_the_others_give(seed: int, share: float) -> None:
    clean, spoilt = (refine(each, reference="view00") for each in far_boards(seed, share))
    assert spoilt.noise_px == pytest.approx(0.1, rel=0.06)
    assert abs(spoilt.camera.intrinsics.f - clean.camera.intrinsics.f) < 3.0 * clean.intrinsics_std[0]


@pytest.mark.parametrize("name", sorted(PROJECTS))
def test_gross_errors_show_without_a_camera(name: str) -> None:
    seen = observations(make_scene(name).corners.views, BOARD, FRAME)
    assert coherent(seen).all()
    image, wrong = np.array(seen.image), [3, 17, 60, 100, 200]
    image[wrong] += 0.25 * np.array([[1, 0], [0, -1], [-1, 0], [0, 1], [0.7, 0.7]])
    assert np.flatnonzero(~coherent(dataclasses.replace(seen, image=image))).tolist() == wrong


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
