"""The virtual camera: there and back, standard deviations, and where to believe it."""

from dataclasses import replace

import numpy as np
import pytest

from pinholify.camera import Domain
from pinholify.io.importing.adoption import adopt
from pinholify.io.importing.base import ForeignCamera
from pinholify.pipeline import calibrate
from synthetic import CENTRE, FOCAL, SIZE, TRUE_F, corner_set, project

SQUEEZE = 0.15


def pixels():
    return np.random.default_rng(0).uniform([250, 200], [1670, 1000], (200, 2))


@pytest.mark.parametrize("trend", ["constant", "lens:3", "homography", "polynomial:3"])
def test_pixels_to_rays_and_back(trend):
    camera = calibrate(corner_set(squeeze=SQUEEZE), reference="view0.png", method="one-image", trend=trend).camera
    uv = pixels()
    tolerance = 0.01 if trend == "constant" else 1e-4  # the constant mean's kernel sum rounds
    np.testing.assert_allclose(camera.project(5.0 * camera.to_rays(uv).directions), uv, atol=tolerance)
    np.testing.assert_allclose(camera.from_virtual(camera.virtual_points(uv)).points, uv, atol=tolerance)


def test_rays_are_the_true_ones(barrel_calibration):
    """The frame is the reference board's, which here is the true camera's."""
    camera = barrel_calibration.camera
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-6, 6, 100), rng.uniform(-3.5, 3.5, 100), np.full(100, TRUE_F)])
    rays = camera.to_rays(project(points, SQUEEZE))
    truth = points / np.linalg.norm(points, axis=1, keepdims=True)
    angle = np.linalg.norm(np.cross(rays.directions, truth), axis=1)
    assert np.sqrt((angle**2).mean()) * FOCAL < 3.0
    np.testing.assert_array_equal(rays.origins, 0.0)
    assert (rays.std_px > 0).all()


def test_the_jacobian_of_the_virtual_plane(barrel_calibration):
    camera, uv, h = barrel_calibration.camera, pixels()[:20], 1e-2
    numeric = [(camera.virtual_points(uv + e) - camera.virtual_points(uv - e)) / (2 * h) for e in np.eye(2) * h]
    np.testing.assert_allclose(camera.virtual_jacobian(uv), np.stack(numeric, -1), atol=1e-7)


def test_the_std_grows_outside_the_reference_board(barrel_calibration):
    camera = barrel_calibration.camera
    at = camera.to_rays(np.array([CENTRE, [3.0, 3.0]])).std_px
    assert at[1] > 5 * at[0]
    assert camera.inside(np.array([CENTRE, [3.0, 3.0]])).tolist() == [True, False]


def test_a_limit_on_the_std_narrows_the_domain(barrel_calibration):
    camera = barrel_calibration.camera
    uv = pixels()
    std = camera.shape_std(uv)
    limited = replace(camera, domain=Domain(camera.domain.hull, float(np.median(std))))
    np.testing.assert_array_equal(limited.inside(uv), camera.inside(uv) & (std <= np.median(std)))
    assert 0.3 < limited.inside(uv).mean() < 0.7


def test_what_cannot_be_seen_is_nan(barrel_calibration):
    camera = barrel_calibration.camera
    mapped = camera.from_rays(np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert np.isnan(mapped.points).any(axis=1).tolist() == [True, True, False]
    assert np.isnan(mapped.std).any(axis=1).tolist() == [True, True, False]


def test_many_small_questions_prepare_once(barrel_calibration):
    """A lone point's pixel costs about what the map's own inverse does, after the first."""
    camera, asked = replace(barrel_calibration.camera), []

    class Counted:
        def __getattr__(self, name):
            return getattr(barrel_calibration.camera.plane_map, name)

        def value(self, uv):
            asked.append(len(uv))
            return barrel_calibration.camera.plane_map.value(uv)

    camera = replace(camera, plane_map=Counted())
    first = [camera.project(np.array([[x, 0.2, 1.0]])) for x in (0.1, 0.2, 0.3)]
    assert sum(n > 100 for n in asked) == 1
    together = barrel_calibration.camera.project(np.array([[x, 0.2, 1.0] for x in (0.1, 0.2, 0.3)]))
    np.testing.assert_allclose(np.concatenate(first), together, atol=1e-6)


def barrel(xyz):
    return np.where(xyz[:, 2:] > 0, project(xyz, SQUEEZE), np.nan)


KINDS = ["constant", "lens", "plane", "angle", "imported"]


@pytest.fixture(scope="module", params=KINDS)
def any_camera(request, barrel_calibration):
    """A camera of every kind of map."""
    views = corner_set(6, squeeze=SQUEEZE)
    if request.param == "constant":
        return calibrate(views, reference="view0.png", method="one-image", trend="constant").camera
    if request.param == "lens":
        return barrel_calibration.camera
    if request.param == "imported":
        focal = np.full(2, FOCAL)
        return adopt(ForeignCamera("a", "test", "barrel", barrel, focal, CENTRE, SIZE)).calibration.camera
    return calibrate(views, method="joint", trend=f"{request.param}:1").camera


def test_every_pixel_has_a_number_or_nan(any_camera):
    far = [[1e3 * 10.0**k, -(10.0**k)] for k in (2, 3, 5, 20, 150, 300)]
    broken = [[np.nan, 1.0], [np.inf, 2.0], [5.0, -np.inf], [np.nan, np.nan]]
    uv = np.concatenate([[CENTRE], far, broken])
    rays, virtual = any_camera.to_rays(uv), any_camera.to_virtual(uv)
    answers = [rays.directions, rays.std_px, virtual.points, virtual.covariance, any_camera.virtual_points(uv)]
    answers += [any_camera.virtual_jacobian(uv), any_camera.pixel_covariance(uv), any_camera.shape_std(uv)]
    for answer in answers:
        assert len(answer) == len(uv)
        assert np.isfinite(answer[0]).all()
        assert np.isnan(answer[-len(broken) :]).all()
        assert not np.isinf(answer).any()
    assert any_camera.inside(uv).tolist() == [True] + [False] * (len(uv) - 1)
    alone = any_camera.to_rays(np.array([[np.nan, 1.0]]))
    assert np.isnan(alone.directions).all()
    assert any_camera.to_rays(np.empty((0, 2))).std_px.shape == (0,)


def test_every_point_has_a_pixel_or_nan(any_camera):
    broken = [[np.nan, 0.0, 1.0], [np.inf, 0.0, 1.0], [0.0, 0.0, -np.inf], [1e300, 0.0, 1.0]]
    axis = any_camera.to_rays(np.array([CENTRE])).directions
    seen = any_camera.from_rays(np.concatenate([axis, broken]))
    np.testing.assert_allclose(seen.points[0], CENTRE, atol=0.01)
    assert np.isnan(seen.points[1:]).all()
    assert np.isnan(seen.covariance[1:]).all()
    assert np.isnan(any_camera.from_virtual(np.array([[np.nan, 0.0], [np.inf, 0.0]])).points).all()


def test_another_k_moves_rays_and_virtual_points_alike(any_camera):
    """K has one owner: the rays of a plane chart and the virtual points of every camera follow it together."""
    k = any_camera.intrinsics
    other = replace(any_camera, chart=replace(any_camera.chart, intrinsics=replace(k, f=2.0 * k.f)))
    uv = pixels()[:10]
    np.testing.assert_allclose(other.from_virtual(other.virtual_points(uv)).points, uv, atol=0.01)
    np.testing.assert_allclose(other.intrinsics.project(other.to_rays(uv).directions), other.virtual_points(uv))
