"""Points in OpenCV's way: against OpenCV itself on its own lens, and there and back."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import AngleChart, Intrinsics, PlaneChart
from pinholify.errors import InputError
from pinholify.geometry import Pose, convex_hull
from pinholify.points import (
    MANY,
    distort_points,
    distort_points_jacobian,
    pixel_rays,
    pixel_rays_jacobian,
    project_points,
    project_points_jacobian,
    solve_pnp,
    undistort_points,
    undistort_points_jacobian,
)

SIZE = (640, 480)
K = np.array([[420.0, 0.0, 325.0], [0.0, 420.0, 236.0], [0.0, 0.0, 1.0]])
DISTORTION = np.array([-0.18, 0.03, 0.0, 0.0])
TURN = Rotation.from_rotvec([0.1, -0.15, 0.05]).as_matrix()
FOCAL = 9.0  # squares
FRAME = np.array([[0.0, 0.0], [639, 0], [639, 479], [0, 479]])
CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-14)


def opencv_undistorted(uv, r=None, p=None):
    """OpenCV's answer, iterated to the end; OpenCV 4 has another function for it than OpenCV 5."""
    rotation, matrix = (np.eye(3) if m is None else m for m in (r, p))
    if hasattr(cv2, "undistortPointsIter"):
        return cv2.undistortPointsIter(uv, K, DISTORTION, rotation, matrix, CRITERIA)[:, 0]
    return cv2.undistortPoints(uv, K, DISTORTION, R=rotation, P=matrix, criteria=CRITERIA)[:, 0]


class OpenCVMap:
    """OpenCV's lens as the map of a virtual camera, in the place of a learnt one: what it says is the truth."""

    def value(self, uv):
        return FOCAL * opencv_undistorted(uv)

    def jacobian(self, uv):
        return np.linalg.inv(self._projected(self.value(uv))[1][:, 3:5].reshape(-1, 2, 2) / FOCAL)

    def inverse(self, q, nearby):
        return self._projected(q)[0][:, 0]

    def _projected(self, q):
        xyz = np.column_stack([q / FOCAL, np.ones(len(q))])
        return cv2.projectPoints(xyz, np.zeros(3), np.zeros(3), K, DISTORTION)


class AngleMap:
    """An ideal equidistant fisheye of ``scale`` px per radian."""

    def __init__(self, scale):
        self.scale = scale

    def value(self, uv):
        return (uv - K[:2, 2]) / self.scale

    def jacobian(self, uv):
        return np.broadcast_to(np.eye(2) / self.scale, (len(uv), 2, 2))

    def inverse(self, q, nearby):
        return q * self.scale + K[:2, 2]


@pytest.fixture(scope="module")
def camera():
    intrinsics = Intrinsics(FOCAL, 0.0, 0.0)
    return VirtualCamera(OpenCVMap(), PlaneChart(intrinsics), Domain(convex_hull(FRAME)), SIZE, 0.1)


def pixels(count=300):
    return np.random.default_rng(0).uniform([60, 40], [580, 440], (count, 2))


@pytest.mark.parametrize(("r", "p"), [(None, None), (TURN, None), (None, 2 * K), (TURN, np.column_stack([K, K[:, 0]]))])
def test_undistorting_is_opencvs(camera, r, p):
    answer = undistort_points(pixels(), camera, r, p)
    np.testing.assert_allclose(answer, opencv_undistorted(pixels(), r, p), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("r", "p"), [(None, None), (TURN, 2 * K)])
def test_there_and_back(camera, r, p):
    back = distort_points(undistort_points(pixels(), camera, r, p), camera, r, p)
    np.testing.assert_allclose(back, pixels(), atol=1e-7)


def test_rays_are_unit_and_turn_with_the_frame(camera):
    rays = pixel_rays(pixels(), camera)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    np.testing.assert_allclose(pixel_rays(pixels(), camera, TURN), rays @ TURN.T)
    np.testing.assert_allclose(rays[:, :2] / rays[:, 2:], undistort_points(pixels(), camera))


@pytest.mark.parametrize("shape", [(7, 2), (7, 1, 2), (1, 7, 2), (0, 2), (2,)])
def test_shapes_are_kept(camera, shape):
    uv = np.full(shape, 300.0, dtype=np.float32)
    assert undistort_points(uv, camera).shape == shape
    assert distort_points(np.zeros(shape), camera).shape == shape
    assert pixel_rays(uv, camera).shape == (*shape[:-1], 3)
    image, jacobian = project_points(np.ones((*shape[:-1], 3)), np.zeros(3), np.array([0.0, 0, 9]), camera)
    assert image.shape == shape
    assert jacobian.shape == (uv.size, 6)


def test_points_of_other_dimensions_are_a_mistake(camera):
    with pytest.raises(InputError, match=r"shape \(3, 3\) were given where \(N, 2\), \(N, 1, 2\)"):
        undistort_points(np.eye(3), camera)


def test_what_does_not_exist_is_nan(camera):
    assert np.isnan(undistort_points([[np.nan, 3.0], [300.0, 200.0]], camera)).tolist() == [[True] * 2, [False] * 2]
    behind = Rotation.from_rotvec([0.0, np.pi, 0.0]).as_matrix()
    assert np.isnan(undistort_points([[300.0, 200.0]], camera, behind)).all()
    image, jacobian = project_points([[0.0, 0.0, -30.0], [0.0, 0.0, 0.0]], np.zeros(3), np.array([0, 0, 9.0]), camera)
    assert np.isnan(image).all(axis=1).tolist() == [True, False]
    assert np.isnan(jacobian).all(axis=1).tolist() == [True, True, False, False]


RVEC, TVEC = np.array([0.3, -0.4, 0.2]), np.array([0.5, -0.3, 12.0])


def solid_points():
    return np.random.default_rng(2).uniform([-4, -3, -2], [4, 3, 2], (40, 3))


def test_projecting_is_opencvs(camera):
    points = solid_points()
    truth, truth_jacobian = cv2.projectPoints(points, RVEC, TVEC, K, DISTORTION)
    image, jacobian = project_points(points, RVEC, TVEC, camera)
    np.testing.assert_allclose(image, truth[:, 0], atol=1e-9)
    np.testing.assert_allclose(jacobian, truth_jacobian[:, :6], atol=1e-6)


@pytest.mark.parametrize(
    ("rvec", "r"), [(RVEC, TURN), (np.array([1e-5, 2e-5, -1e-5]), None), (np.array([1.5, -2.0, 1.0]), None)]
)
def test_the_derivative_is_that_of_the_projection(camera, rvec, r):
    points = 0.5 * solid_points()
    jacobian, step = project_points(points, rvec, TVEC, camera, r)[1], 1e-4
    for column in range(6):
        move = step * np.eye(6)[column]
        ends = [project_points(points, rvec + s * move[:3], TVEC + s * move[3:], camera, r)[0] for s in (1, -1)]
        numeric = (ends[0] - ends[1]).ravel() / (2 * step)
        np.testing.assert_allclose(jacobian[:, column], numeric, atol=1e-6 * np.abs(jacobian).max())


@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("r", [None, TURN])
def test_poses_come_back(camera, flat, r):
    points = solid_points() * [1.0, 1.0, 0.0 if flat else 1.0]
    image = project_points(points, RVEC, TVEC, camera, r)[0]
    found, rvec, tvec = solve_pnp(points, image[:, None], camera, r)
    assert found
    assert rvec.shape == tvec.shape == (3, 1)
    np.testing.assert_allclose(rvec[:, 0], RVEC, atol=1e-7)
    np.testing.assert_allclose(tvec[:, 0], TVEC, atol=1e-6)


def test_a_noisy_pose_is_of_least_squares(camera):
    points = solid_points()
    seen = project_points(points, RVEC, TVEC, camera)[0] + np.random.default_rng(3).normal(0, 0.3, (40, 2))
    _, rvec, tvec = solve_pnp(points, seen, camera)
    image, jacobian = project_points(points, rvec, tvec, camera)
    gradient = jacobian.T @ (image - seen).ravel()
    assert np.linalg.norm(np.linalg.solve(jacobian.T @ jacobian, gradient)) < 1e-3
    truth = cv2.solvePnP(points, seen, K, DISTORTION)
    np.testing.assert_allclose(np.concatenate([rvec, tvec]), np.concatenate(truth[1:]), atol=1e-4)


def test_too_few_points_are_refused(camera):
    with pytest.raises(InputError, match="a pose needs 4 points whose pixels have rays, and 3 of 3 do"):
        solve_pnp(np.eye(3), pixels(3), camera)
    with pytest.raises(InputError, match="5 points and 4 pixels"):
        solve_pnp(np.ones((5, 3)), pixels(4), camera)


class PartlyBlindMap(OpenCVMap):
    """Left of column 100 the camera sees nothing; below row 1000 it sees everywhere the same."""

    def value(self, uv):
        return np.where(uv[:, :1] < 100, np.nan, super().value(uv))

    def jacobian(self, uv):
        jacobian = np.where(uv[:, :1, None] < 100, np.nan, super().jacobian(uv))
        return np.where(uv[:, 1:, None] > 1000, 0.0, jacobian)


def test_pixels_without_rays_do_not_spoil_a_pose(camera):
    points = np.concatenate([solid_points(), np.zeros((2, 3))])
    image = project_points(points, RVEC, TVEC, camera)[0]
    image[-2:] = [[50.0, 200.0], [300.0, 5000.0]]
    partly = replace(camera, plane_map=PartlyBlindMap())
    assert (image[:-2, 0] > 100).all()
    _, rvec, tvec = solve_pnp(points, image, partly)
    np.testing.assert_allclose(rvec[:, 0], RVEC, atol=1e-7)
    np.testing.assert_allclose(tvec[:, 0], TVEC, atol=1e-6)
    with pytest.raises(InputError, match="whose pixels have rays, and 3 of 5 do"):
        solve_pnp(points[-5:], image[-5:], partly)


@pytest.mark.parametrize("points", [np.outer(np.linspace(-3, 3, 9), [1.0, 2.0, 0.5]), np.ones((9, 3))])
def test_points_on_a_line_are_refused(camera, points):
    with pytest.raises(InputError, match="lie on one line"):
        solve_pnp(points, pixels(9), camera)


@pytest.mark.parametrize("unit", [1e-4, 1e3])
def test_the_unit_of_length_is_free(camera, unit):
    square = np.array([[0.0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0]])
    image = project_points(square, RVEC, TVEC, camera)[0]
    _, rvec, tvec = solve_pnp(unit * square, image, camera)
    np.testing.assert_allclose(rvec[:, 0], RVEC, atol=1e-6)
    np.testing.assert_allclose(tvec[:, 0], unit * TVEC, rtol=1e-6)


def test_the_origin_of_the_points_is_free(camera):
    points, origin = solid_points(), np.array([9000.0, -4000.0, 2500.0])
    image = project_points(points, RVEC, TVEC, camera)[0]
    _, rvec, tvec = solve_pnp(points + origin, image, camera)
    rotation = Rotation.from_rotvec(RVEC).as_matrix()
    np.testing.assert_allclose(rvec[:, 0], RVEC, atol=1e-7)
    np.testing.assert_allclose(tvec[:, 0], TVEC - rotation @ origin, atol=1e-5)


def test_points_all_around_a_wide_lens_give_a_pose():
    """Rays up to 105° from the axis, in a chart that reaches them."""
    rng, square, pose = np.random.default_rng(5), 300.0, Pose(Rotation.from_rotvec(RVEC).as_matrix(), 0.3 * TVEC)
    wide = VirtualCamera(
        AngleMap(square), AngleChart(np.eye(3), Intrinsics(1.0, 0.0, 0.0)), Domain(convex_hull(FRAME)), SIZE, 0.1
    )
    points = (wide.chart.directions(rng.uniform(-1.3, 1.3, (60, 2))) * 8.0 - pose.translation) @ pose.rotation
    _, rvec, tvec = solve_pnp(points, project_points(points, RVEC, 0.3 * TVEC, wide)[0], wide)
    np.testing.assert_allclose(rvec[:, 0], RVEC, atol=1e-7)
    np.testing.assert_allclose(tvec[:, 0], 0.3 * TVEC, atol=1e-6)


def numeric_jacobian(function, points, step):
    """∂ ``function``/∂ points (n, outputs, inputs) by central differences."""
    moves = np.eye(points.shape[1]) * step
    return np.stack([(function(points + m) - function(points - m)) / (2 * step) for m in moves], axis=-1)


@pytest.mark.parametrize(("r", "p"), [(None, None), (TURN, 2 * K), (TURN, None)])
def test_derivatives_by_the_pixel(camera, r, p):
    uv = pixels(40)
    for function, jacobian, options in (
        (undistort_points, undistort_points_jacobian, (r, p)),
        (pixel_rays, pixel_rays_jacobian, (r,)),
    ):
        found = jacobian(uv, camera, *options)
        truth = numeric_jacobian(lambda x, f=function, o=options: f(x, camera, *o), uv, 1e-3)
        np.testing.assert_allclose(found, truth, atol=1e-6 * np.abs(truth).max())


@pytest.mark.parametrize(("r", "p"), [(None, None), (TURN, 2 * K)])
def test_the_derivative_of_distorting_is_the_inverse_of_undistortings(camera, r, p):
    uv = pixels(40)
    plane = undistort_points(uv, camera, r, p)
    product = distort_points_jacobian(plane, camera, r, p) @ undistort_points_jacobian(uv, camera, r, p)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(2), product.shape), atol=1e-7)


@pytest.mark.parametrize("r", [None, TURN])
def test_the_derivative_of_projecting_by_the_points(camera, r):
    points = 0.5 * solid_points()
    found = project_points_jacobian(points, RVEC, TVEC, camera, r)
    truth = numeric_jacobian(lambda x: project_points(x, RVEC, TVEC, camera, r)[0], points, 1e-4)
    np.testing.assert_allclose(found, truth, atol=1e-6 * np.abs(truth).max())


def test_derivatives_keep_the_shape_of_the_points_and_are_nan_where_those_are(camera):
    uv = np.array([[[300.0, 200.0]], [[np.nan, 3.0]]])
    for jacobian, rows in ((undistort_points_jacobian, 2), (pixel_rays_jacobian, 3), (distort_points_jacobian, 2)):
        found = jacobian(uv / 1000.0 if jacobian is distort_points_jacobian else uv, camera)
        assert found.shape == (2, 1, rows, 2)
        assert np.isnan(found).all(axis=(2, 3))[:, 0].tolist() == [False, True]
    behind = project_points_jacobian([[0.0, 0.0, -30.0], [0.0, 0.0, 0.0]], np.zeros(3), [0, 0, 9.0], camera)
    assert np.isnan(behind).all(axis=(1, 2)).tolist() == [True, False]


@pytest.mark.parametrize(("r", "p"), [(None, None), (TURN, 2 * K)])
def test_many_points_are_as_few_within_a_thousandth_of_a_pixel(camera, r, p):
    uv = np.random.default_rng(4).uniform([-0.5, -0.5], [639.5, 479.5], (MANY, 2))
    exact = undistort_points(uv, camera, r, p, tolerance=0.0)
    many = undistort_points(uv, camera, r, p)
    assert np.abs(many - exact).max() > 0.0
    by_pixel = undistort_points_jacobian(uv, camera, r, p)
    shift = np.linalg.solve(by_pixel, (many - exact)[:, :, None])
    assert np.linalg.norm(shift, axis=1).max() < 1e-3
    assert np.linalg.norm(distort_points(exact, camera, r, p) - uv, axis=1).max() < 1e-3
    angle = np.linalg.norm(pixel_rays(uv, camera, r) - pixel_rays(uv, camera, r, tolerance=0.0), axis=1)
    assert angle.max() * K[0, 0] < 1e-3


def test_many_points_of_a_wide_lens_there_and_back():
    """Rays up to 115° from the axis: directions come from a table too, and half of the pixels have no plane point."""
    wide = VirtualCamera(
        AngleMap(200.0), AngleChart(np.eye(3), Intrinsics(1.0, 0.0, 0.0)), Domain(convex_hull(FRAME)), SIZE, 0.1
    )
    uv = np.random.default_rng(4).uniform([0.0, 0.0], [639.0, 479.0], (MANY, 1, 2))
    angles = (uv[:, 0] - K[:2, 2]) / 200.0
    np.testing.assert_allclose(pixel_rays(uv, wide, tolerance=2e-4)[:, 0], wide.chart.directions(angles), atol=1e-6)
    plane = undistort_points(uv, wide)
    ahead = np.linalg.norm(angles, axis=1) < np.pi / 2
    np.testing.assert_array_equal(np.isfinite(plane[:, 0]).all(axis=1), ahead)
    back = distort_points(plane, wide)
    np.testing.assert_allclose(back[ahead], uv[ahead], atol=1e-3)
    assert np.isnan(back[~ahead]).all()


WRONG = {
    "a ragged list": (lambda camera: undistort_points([[1, 2], [3]], camera), "not all numbers"),
    "no camera": (lambda camera: undistort_points(SOME, np.eye(3)), "a ndarray was given where a VirtualCamera"),
    "a calibration": (lambda camera: distort_points(SOME, object()), "give the .camera of the result"),
    "a rotation vector": (lambda camera: undistort_points(SOME, camera, np.zeros(3)), r"R of shape \(3,\)"),
    "a small matrix": (lambda camera: undistort_points(SOME, camera, None, np.eye(2)), r"P of shape \(2, 2\)"),
    "a singular matrix": (lambda camera: distort_points(SOME, camera, None, np.zeros((3, 3))), "P .* no inverse"),
    "a rotation matrix": (lambda camera: project_points(SPACE, np.eye(3), np.ones(3), camera), r"rvec of shape \(3, 3"),
    "two numbers": (lambda camera: project_points(SPACE, np.zeros(3), np.ones(2), camera), r"tvec of shape \(2,\)"),
}
SOME, SPACE = np.full((3, 2), 0.1), np.ones((3, 3))


@pytest.mark.parametrize("name", WRONG)
def test_wrong_arguments_are_refused_in_a_sentence(name, camera):
    call, sentence = WRONG[name]
    with pytest.raises(InputError, match=sentence):
        call(camera)
