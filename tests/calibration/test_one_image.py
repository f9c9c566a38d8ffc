"""One photograph makes the camera: truth, error bars by Monte Carlo, and what is refused."""

import dataclasses

import numpy as np
import pytest

from pinholify.calibration.observation import estimate_pose, observe, sighting_of
from pinholify.calibration.one_image import calibrate_one_image
from pinholify.corners import not_found
from pinholify.errors import CalibrationError, DegenerateError, InputError
from synthetic import BOARD, TRUE_F, board_poses, corner_set

TRUTH = (TRUE_F, 7.0, 4.0)


def one_image(corners, **options):
    return calibrate_one_image(corners, **{"reference": "view0.png", "trend": "lens:3"} | options)


def k_of(calibration):
    k = calibration.camera.intrinsics
    return np.array([k.f, k.uc, k.vc])


def test_without_noise_k_is_exact():
    calibration = one_image(corner_set(noise=1e-9), trend="homography")
    np.testing.assert_allclose(k_of(calibration), TRUTH, atol=1e-6)


def test_behind_barrel_distortion_k_and_poses_are_found(barrel_set, barrel_calibration):
    np.testing.assert_allclose(k_of(barrel_calibration), TRUTH, atol=0.02)
    closed = barrel_calibration.closed_form
    np.testing.assert_allclose([closed.f, closed.uc, closed.vc], TRUTH, atol=0.03)
    _, observed = observe(barrel_calibration.camera, barrel_set)
    assert len(observed) == 9
    for i, (rotation, translation) in enumerate(board_poses(9, 0)):
        pose = observed[f"view{i}.png"].refined
        np.testing.assert_allclose(pose.rotation, rotation, atol=5e-3)
        np.testing.assert_allclose(pose.translation, translation, atol=0.05)


def test_least_squares_is_nearer_the_truth_than_the_closed_form():
    found, closed = [], []
    for seed in range(8):
        calibration = one_image(corner_set(seed=seed), trend="homography")
        found.append(k_of(calibration) - TRUTH)
        k = calibration.closed_form
        closed.append(np.array([k.f, k.uc, k.vc]) - TRUTH)
    assert np.square(found).sum() < 0.9 * np.square(closed).sum()


def test_a_pose_is_estimated_from_any_corners(barrel_set, barrel_calibration):
    view, camera = barrel_set.views[3], barrel_calibration.camera
    pose, covariance = estimate_pose(camera, sighting_of(camera, view.lattice(BOARD), view.uv))
    rotation, translation = board_poses(9, 0)[3]
    np.testing.assert_allclose(pose.rotation, rotation, atol=5e-3)
    np.testing.assert_allclose(pose.translation, translation, atol=0.05)
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_the_largest_whole_board_is_the_reference(barrel_set):
    views = list(barrel_set.views)
    views[0], views[4] = views[4], views[0]
    chosen = calibrate_one_image(barrel_set.with_views(views), trend="lens:2").reference
    assert chosen == "view0.png"


def test_partial_views_and_missing_boards_are_normal(barrel_set):
    rng = np.random.default_rng(0)
    views = [v if i == 0 else v.select(rng.uniform(size=135) < 0.6) for i, v in enumerate(barrel_set.views)]
    views.append(not_found("empty.png", "too dark"))
    calibration = one_image(barrel_set.with_views(views))
    np.testing.assert_allclose(k_of(calibration), TRUTH, atol=0.03)


def test_a_board_numbered_the_other_way_round_is_named(barrel_set):
    wrong = barrel_set.views[5]
    flipped = dataclasses.replace(wrong, ids=wrong.ids.reshape(9, 15)[:, ::-1].ravel())
    views = [flipped if v is wrong else v for v in barrel_set.views]
    calibration = one_image(barrel_set.with_views(views))
    boards, _ = observe(calibration.camera, barrel_set.with_views(views))
    assert [b.name for b in boards if not b.used] == ["view5.png"]
    assert "handedness" in boards[5].reason
    np.testing.assert_allclose(k_of(calibration), TRUTH, atol=0.02)


def test_wrong_corners_are_named(barrel_set):
    view = barrel_set.views[5]
    uv = view.uv.copy()
    uv[[3, 40]] = uv[[40, 3]]
    views = [dataclasses.replace(v, uv=uv) if v is view else v for v in barrel_set.views]
    boards, _ = observe(one_image(barrel_set).camera, barrel_set.with_views(views))
    assert [b.name for b in boards if not b.used] == ["view5.png"]
    assert "wrong corners" in boards[5].reason


def test_a_mirrored_camera_needs_to_be_said(barrel_set):
    flipped = [dataclasses.replace(v, uv=v.uv * [-1, 1] + [1919, 0]) for v in barrel_set.views]
    mirrored = barrel_set.with_views(flipped)
    with pytest.raises(InputError, match="set 'mirrored'"):
        one_image(mirrored)
    calibration = one_image(mirrored, mirrored=True)
    np.testing.assert_allclose(k_of(calibration), TRUTH, atol=0.02)
    assert calibration.camera.mirrored
    with pytest.raises(InputError, match="leave 'mirrored' off"):
        one_image(barrel_set, mirrored=True)


@pytest.mark.parametrize("keep", [1, 2])
def test_too_few_boards_are_refused(barrel_set, keep):
    with pytest.raises(DegenerateError, match="3 or more are needed"):
        one_image(barrel_set.with_views(barrel_set.views[:keep]))


@pytest.mark.parametrize("groups", [1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_parallel_boards_are_refused(groups, seed):
    rng = np.random.default_rng(seed)
    tilted = board_poses(2, 3)[1][0]
    poses = [(np.eye(3), np.array([-7.0, -4.0, TRUE_F]))]
    for i in range(8):
        rotation = tilted if i % groups else np.eye(3)
        centre = np.array([rng.uniform(-2, 2), rng.uniform(-1, 1), rng.uniform(14, 18)])
        poses.append((rotation, centre - rotation[:, :2] @ [7.0, 4.0]))
    with pytest.raises(DegenerateError, match="singular values"):
        one_image(corner_set(poses=poses, seed=seed), trend="homography")


def test_no_board_at_all_is_refused(barrel_set):
    with pytest.raises(CalibrationError, match="no 15x9 board was found in any of the 1 images"):
        calibrate_one_image(barrel_set.with_views([not_found("a.png", "nothing")]))


@pytest.mark.parametrize("name", ["nobody.png", "view"])
def test_an_unknown_reference_is_refused(barrel_set, name):
    with pytest.raises(InputError, match="is the name of none"):
        calibrate_one_image(barrel_set, reference=name)


def test_a_reference_may_be_named_without_its_folder(barrel_set):
    views = [dataclasses.replace(v, name=f"a/{v.name}") for v in barrel_set.views]
    assert one_image(barrel_set.with_views(views)).reference == "a/view0.png"
    twice = [*views, dataclasses.replace(views[0], name="b/view0.png")]
    with pytest.raises(InputError, match="is the name of 2"):
        one_image(barrel_set.with_views(twice))


@pytest.mark.slow
def test_the_error_bars_of_k_are_honest():
    """200 draws: predicted against sampled spread of K and of rays, and how often ±1.96 σ covers the true K."""
    poses, uv = board_poses(9, 0), np.array([[300.0, 300.0], [960.0, 600.0], [1500.0, 900.0], [1600.0, 250.0]])
    found, std, rays, lengths, rays_std = [], [], [], [], []
    for seed in range(200):
        calibration = one_image(corner_set(squeeze=0.15, seed=seed, poses=poses))
        found.append(k_of(calibration))
        std.append(calibration.intrinsics_std)
        seen, camera = calibration.camera.to_rays(uv), calibration.camera
        by_px = camera.chart.direction_jacobian(camera.plane_map.value(uv)) @ camera.plane_map.jacobian(uv)
        rays.append(seen.directions)
        lengths.append(np.linalg.norm(by_px, axis=(1, 2)))  # of one px along each axis
        rays_std.append(seen.std_px)
    ratio = np.sqrt(np.mean(np.square(std), axis=0)) / np.std(found, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.15)
    covered = (np.abs(np.array(found) - TRUTH) < 1.96 * np.array(std)).mean()
    assert 0.92 < covered < 0.975
    spread = np.sqrt(np.var(rays, axis=0).sum(axis=1)) / np.mean(lengths, axis=0)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(rays_std), axis=0)) / spread, 1.0, atol=0.15)
