"""What all boards' corners share in the board's axes is told from noise, and from errors of a board of its own."""

from dataclasses import replace

import numpy as np
import pytest

from pinholify.board import lattice
from pinholify.corners import Corners, CornerSet
from pinholify.evaluation.shared_error import shared_error_of
from pinholify.evaluation.summary import evaluate
from pinholify.evaluation.verdict import judge
from pinholify.pipeline import calibrate
from pinholify.refinement import cleaning, joint
from synthetic import BOARD, SIZE, board_poses, project

POINTS = np.column_stack([lattice(BOARD), np.zeros(135)])
S_BEND = np.column_stack([np.zeros((135, 2)), np.sin(np.pi * (POINTS[:, 0] - 7.0) / 7.0)])  # squares
PHOTOGRAPHS = 12


def photographed(shifts, seed=0, noise=0.1):
    """Corners of boards whose points are moved by ``shifts`` (135, 3) squares: the same for all, or one a board."""
    rng = np.random.default_rng(seed)
    views = []
    for i, (rotation, translation) in enumerate(board_poses(PHOTOGRAPHS, seed)):
        moved = POINTS + (shifts if np.ndim(shifts) == 2 else shifts[i])
        uv = project(moved @ rotation.T + translation) + rng.normal(0, noise, (135, 2))
        views.append(Corners(f"view{i}.png", np.arange(135), uv))
    return CornerSet(BOARD, SIZE, tuple(views))


def scored(corners):
    calibration = calibrate(corners, reference="view0.png", method="joint", trend="plane:0")
    return evaluate(calibration, corners, compare_opencv=False)


@pytest.fixture
def unwarped(monkeypatch):
    """The refinement as if no board had a shape of its own, none moved and none was noisier than others."""
    monkeypatch.setattr(joint, "warp_of", lambda *_: None)
    monkeypatch.setattr(joint, "motion_of", lambda *_: 0.0)
    monkeypatch.setattr(cleaning, "trusts", lambda _, seen, __: np.ones(seen.boards))


def found(corners):
    evaluation = scored(corners)
    return shared_error_of(evaluation.calibration.camera, evaluation.observed.values())


def test_noise_is_not_shared():
    values = [found(photographed(0.0 * POINTS, seed)).p_value for seed in range(8)]
    assert min(values) > 0.01
    assert 0.2 < np.mean(values) < 0.8


@pytest.mark.parametrize(
    "shifts",
    [0.01 * S_BEND, np.where(POINTS[:, :1] > 7.0, [[0.003, 0.0, 0.0]], 0.0)],
    ids=["bent like an S", "a seam"],
)
def test_what_the_board_has_is_shared(shifts, unwarped):
    shared = found(photographed(shifts))
    assert shared.p_value < 1e-6
    exact = photographed(0.0 * POINTS, noise=0.0), photographed(shifts, noise=0.0)
    moved = np.concatenate([b.uv - a.uv for a, b in zip(*(each.views for each in exact), strict=True)])
    assert 0.02 < shared.rms < 1.2 * np.sqrt((moved**2).sum(axis=1).mean())  # poses take up some of it


def test_what_each_board_has_of_its_own_is_not_shared():
    amounts = np.random.default_rng(1).choice([-0.02, 0.02], PHOTOGRAPHS)
    assert found(photographed(amounts[:, None, None] * S_BEND)).p_value > 0.01


def test_one_board_shares_nothing(unwarped):
    evaluation = scored(photographed(0.02 * S_BEND))
    for boards in ([], list(evaluation.observed.values())[:1]):
        shared = shared_error_of(evaluation.calibration.camera, boards)
        assert (shared.rms, shared.p_value) == (0.0, 1.0)


def test_the_verdict_asks_after_the_board_and_is_not_taken_in_by_noise_that_is_none(unwarped):
    corners = photographed(0.3 * S_BEND)
    evaluation = evaluate(
        calibrate(corners, reference="view0.png", method="joint"),
        corners,
        recalibrate=lambda part, name: calibrate(part, reference=name, method="joint"),
        compare_opencv=False,
    )
    verdict = judge(evaluation, corners)
    assert verdict.level == "poor"
    assert "px per axis, where 0.3 px or less is usual" in verdict.sentence
    assert "each corner of the board has the same error on every photograph, " in verdict.sentence
    assert "check that the board is flat and accurately printed" in verdict.sentence


def test_a_board_bent_in_no_simple_bow_is_no_trouble_any_more():
    corners = photographed(0.3 * S_BEND)
    calibration = calibrate(corners, reference="view0.png", method="joint")
    verdict = judge(evaluate(calibration, corners, compare_opencv=False), corners)
    assert verdict.level == "good"
    assert verdict.shared.p_value > 0.01
    bent = calibration.board_points[:, 2] - 0.3 * S_BEND[:, 2]
    planes = np.column_stack([np.ones(135), POINTS[:, :2]])
    left = bent - planes @ np.linalg.lstsq(planes, bent, rcond=None)[0]
    assert np.sqrt((left**2).mean()) < 0.01


def test_errors_finer_than_corners_are_found_are_not_asked_after(unwarped):
    corners = photographed(0.0005 * S_BEND, noise=0.002)
    verdict = judge(scored(corners), corners)
    assert verdict.shared.p_value < 0.01
    assert "same error" not in verdict.sentence


def test_the_verdict_counts_what_boards_moved_and_says_so():
    """Their motions are no fault of the camera's: the yardstick of the held-out error knows them."""
    still = photographed(0.0 * POINTS)
    rng, views = np.random.default_rng(3), []
    for view in still.views:
        late = (view.uv[:, 1:] - view.uv[:, 1:].mean()) / SIZE[1]
        views.append(replace(view, uv=view.uv + late * rng.normal(0, 4.0, 2)))
    moved = still.with_views(views)
    for corners, said in ((still, False), (moved, True)):
        calibration = calibrate(corners, reference="view0.png", method="joint")
        verdict = judge(evaluate(calibration, corners, compare_opencv=False), corners)
        assert ("during the rolling shutter" in verdict.sentence) == said
        assert (calibration.details["motion_px"] > 0.1) == said
        assert "noise alone" not in verdict.sentence
