from dataclasses import replace

import numpy as np
import pytest

from pinholify.arrays import Floats
from pinholify.camera import VirtualCamera
from pinholify.corners import Corners
from pinholify.errors import InputError
from pinholify.modes import binned, cropped
from pinholify.refinement import (
    JointResult,
    compare,
    next_board,
    refine,
    residual_structure,
    suspicious_boards,
)

from .conftest import BOARD, PROJECTS, SIZE, Scene, make_scene


@pytest.fixture(scope="module")
def result(scenes: dict[str, Scene]) -> JointResult:
    return refine(scenes["pinhole"].corners, reference="view00", trend="plane:0")


def mean_std(result: JointResult) -> float:
    u, v = np.meshgrid(np.linspace(0, SIZE[0] - 1, 12), np.linspace(0, SIZE[1] - 1, 12))
    std = result.camera.to_rays(np.column_stack([u.ravel(), v.ravel()])).std_px
    return float(np.sqrt((std**2).mean()))


def test_noise_has_no_structure_and_a_smooth_error_has(scenes: dict[str, Scene], result: JointResult) -> None:
    corners = scenes["pinhole"].corners
    assert residual_structure(result, corners).p_value > 0.01
    bent = {view.name: result.residuals[view.name] + 0.06 * np.sin(view.uv / 70.0) for view in corners.views}
    found = residual_structure(replace(result, residuals=bent), corners)
    assert found.p_value < 1e-3
    assert 0.02 < found.correlation < 0.5


def test_one_corner_has_no_structure(scenes: dict[str, Scene], result: JointResult) -> None:
    alone = {name: np.arange(len(inlier)) == (0 if name == "view00" else -1) for name, inlier in result.inliers.items()}
    found = residual_structure(replace(result, inliers=alone), scenes["pinhole"].corners)
    assert (found.correlation, found.p_value) == (0.0, 1.0)


def test_what_is_alike_within_a_board_only_is_no_structure(scenes: dict[str, Scene], result: JointResult) -> None:
    rng = np.random.default_rng(0)
    shifted = {name: r + rng.normal(0, 0.2, 2) for name, r in result.residuals.items()}
    assert residual_structure(replace(result, residuals=shifted), scenes["pinhole"].corners).p_value > 0.005


def test_a_noisy_board_is_suspicious(scenes: dict[str, Scene]) -> None:
    corners = scenes["pinhole"].corners
    assert not suspicious_boards(refine(corners, reference="view00", trend="plane:0"), corners)
    views = list(corners.views)
    views[6] = replace(views[6], uv=views[6].uv + np.random.default_rng(1).normal(0, 0.15, views[6].uv.shape))
    spoilt = corners.with_views(views)
    found = suspicious_boards(refine(spoilt, reference="view00", trend="plane:0"), spoilt)
    assert [suspicion.name for suspicion in found] == ["view06"]
    assert 1.3 < found[0].ratio < 2.0  # its worst corners are dropped, so less than 1.8


def test_the_next_board_brings_what_it_promises() -> None:
    scene = make_scene("pinhole", views=5)
    before = refine(scene.corners, reference="view00", trend="plane:2")
    advice = next_board(before.camera, BOARD, before.poses)
    assert advice is not None
    assert advice.std_before == pytest.approx(mean_std(before), rel=1e-6)
    assert advice.std_after < 0.9 * advice.std_before
    points = before.poses["view00"].apply(np.zeros((1, 2)))  # the camera frame is the first board's
    assert points.shape == (1, 3)
    uv = before.camera.project(advice.pose.apply(scene.corners.views[0].lattice(BOARD)))
    added = Corners("new", np.arange(54), uv + np.random.default_rng(0).normal(0, 0.1, uv.shape))
    after = refine(
        scene.corners.with_views([*scene.corners.views, added]), reference="view00", trend=before.trend.split("+")[0]
    )
    assert mean_std(after) * before.noise_px / after.noise_px == pytest.approx(advice.std_after, rel=0.25)


def orthographic(xyz: Floats) -> Floats:
    """170° across, a circle with image beyond it, where there is no ray."""
    rho = np.hypot(xyz[:, 0], xyz[:, 1]) + 1e-12
    theta = np.arctan2(rho, xyz[:, 2])
    radius = np.where(theta < np.deg2rad(85.0), 290.0 * np.sin(theta), np.nan)
    return xyz[:, :2] * (radius / rho)[:, None] + [401.0, 297.0]


@pytest.mark.parametrize("trend", ["angle-d:0", "angle-d:1"])
def test_a_lens_that_ends_inside_the_image_has_a_next_board_too(monkeypatch: pytest.MonkeyPatch, trend: str) -> None:
    monkeypatch.setitem(PROJECTS, "orthographic", orthographic)
    scene = make_scene("orthographic")
    result = refine(scene.corners, reference="view00", trend=trend)
    ends = np.array([[0.0, 0.0], [799.0, 0.0], [799.0, 599.0], [0.0, 599.0]])
    assert np.isnan(result.camera.plane_map.jacobian(ends)).any()
    advice = next_board(result.camera, BOARD, result.poses)
    assert advice is not None
    assert np.isfinite(advice.outline).all()
    assert 0.0 < advice.std_after < advice.std_before


def test_two_calibrations_of_one_camera_agree_as_predicted() -> None:
    """Different boards, different reference: nothing but the camera is common."""
    pairs = []
    for seed in range(4):
        one, two = (make_scene("fisheye", seed=2 * seed + i, views=16) for i in (0, 1))
        cameras = [refine(s.corners, reference="view00", trend="angle-d:1").camera for s in (one, two)]
        found = compare(*cameras)
        pairs.append((found.rms(), found.expected_rms))
        assert found.covered.mean() > 0.4
        assert found.rms(everywhere=True) >= 0.0
    measured, expected = np.sqrt(np.mean(np.square(pairs), axis=0))
    assert 0.5 < measured / expected < 1.7


def test_a_changed_camera_is_told(scenes: dict[str, Scene]) -> None:
    """The focal length grew by one part in 400: half a px at the edge, minus what a rotation cannot hide."""
    views = [replace(v, uv=(v.uv - [401, 297]) * 1.0025 + [401, 297]) for v in scenes["pinhole"].corners.views]
    corners = scenes["pinhole"].corners
    one = refine(corners, reference="view00", trend="plane:0").camera
    two = refine(corners.with_views(views), reference="view00", trend="plane:0").camera
    found = compare(one, two)
    radius = np.linalg.norm(found.uv - [401, 297], axis=1)
    np.testing.assert_allclose(np.linalg.norm(found.difference, axis=1), 0.0025 * radius, atol=0.1)
    assert found.rms() > 2 * found.expected_rms


def test_cameras_of_different_images_are_not_compared(result: JointResult) -> None:
    other = replace(result.camera, image_size=(640, 480))
    with pytest.raises(InputError, match=r"800x600.*640x480"):
        compare(result.camera, other)


@pytest.fixture(scope="module")
def pair(scenes: dict[str, Scene], result: JointResult) -> tuple[VirtualCamera, VirtualCamera]:
    """Two calibrations of one camera by different photographs."""
    again = make_scene("pinhole", seed=5)
    return result.camera, refine(again.corners, reference="view00", trend="plane:0").camera


@pytest.mark.parametrize("plain", [False, True])
def test_a_crop_of_the_whole_image_is_compared_like_the_camera(
    pair: tuple[VirtualCamera, VirtualCamera], plain: bool
) -> None:
    one, two = pair
    expected, found = compare(one, two), compare(cropped(one, 0, 0, SIZE), two if plain else cropped(two, 0, 0, SIZE))
    assert found.expected_rms == pytest.approx(expected.expected_rms, rel=1e-9)
    assert found.rms() == pytest.approx(expected.rms(), rel=1e-6)


def test_binned_cameras_differ_by_half_as_many_pixels(pair: tuple[VirtualCamera, VirtualCamera]) -> None:
    expected, found = compare(*pair), compare(*(binned(camera, 2) for camera in pair))
    assert found.expected_rms == pytest.approx(expected.expected_rms / 2.0, rel=0.02)  # its grid ends elsewhere
    assert found.rms() == pytest.approx(expected.rms() / 2.0, rel=0.05)


def test_the_next_board_of_another_mode(result: JointResult) -> None:
    advice = next_board(result.camera, BOARD, result.poses)
    same = next_board(cropped(result.camera, 0, 0, SIZE), BOARD, result.poses)
    assert advice is not None
    assert same is not None
    np.testing.assert_allclose(same.outline, advice.outline, atol=1e-6)
    assert same.std_after == pytest.approx(advice.std_after, rel=1e-9)
    half = next_board(binned(result.camera, 2), BOARD, result.poses)
    assert half is not None
    assert half.std_before == pytest.approx(advice.std_before / 2.0, rel=0.05)
    assert half.std_after == pytest.approx(advice.std_after / 2.0, rel=0.1)
