"""Points through a calibrated camera, in the argument order and shapes of OpenCV's functions of the same names.

``camera`` takes the place of OpenCV's ``cameraMatrix, distCoeffs``. Points may be (N, 2), (N, 1, 2) or (1, N, 2), of
any numeric type; results keep the shape and are float64. Pixels have (0, 0) at the centre of the top-left pixel. The
camera's frame is the reference board's; everywhere ``R`` (3, 3), a rotation from it such as ``View.rotation``, selects
another frame. What does not exist (a pixel that sees no point, a point behind a plane) is nan.

Results come from the same map that straightens images. They are exact for fewer than ``MANY`` points; more may come
from a table with an error of at most ``tolerance`` px of the image, at tens of millions of points per second, unless
``tolerance`` is 0. A table is made when it is first needed and kept for the next call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from pinholify.arrays import Bools, Floats
from pinholify.calibration.observation import FEWEST_POINTS, sighting_of
from pinholify.calibration.poses import refine_pose
from pinholify.camera import VirtualCamera, virtual
from pinholify.errors import InputError
from pinholify.geometry import Pose, homogeneous, inverse_2x2
from pinholify.ray_tables import Sight, exact_sight, tabulated_pixels, tabulated_sight

__all__ = [
    "distort_points",
    "distort_points_jacobian",
    "pixel_rays",
    "pixel_rays_jacobian",
    "project_points",
    "project_points_jacobian",
    "solve_pnp",
    "undistort_points",
    "undistort_points_jacobian",
    "undistortion_table",
]

MANY = 20_000  # points, from which on a table is used
TOLERANCE = 5e-4  # px
LEAST_COSINE = np.cos(np.deg2rad(80.0))  # to the mean ray; farther out, points of a plane across it are useless


def __dir__() -> list[str]:
    return __all__


def undistort_points(
    src: ArrayLike,
    camera: VirtualCamera,
    R: ArrayLike | None = None,
    P: ArrayLike | None = None,
    *,
    tolerance: float = TOLERANCE,
) -> Floats:
    """Ideal pinhole points (…, 2) of the image's pixels ``src`` (…, 2), like ``cv2.undistortPoints``.

    They are normalised, (x/z, y/z), or px of the view whose matrix ``P``, (3, 3) or (3, 4), is given; nan at 90° from
    the z axis of ``R`` and beyond.
    """
    given, uv = _rows(src, 2)
    return _shaped(_undistorted(uv, _sight(camera, len(uv), tolerance), _rotation(R), _matrix(P)), given, 2)


def undistort_points_jacobian(
    src: ArrayLike, camera: VirtualCamera, R: ArrayLike | None = None, P: ArrayLike | None = None
) -> Floats:
    """∂ :func:`undistort_points`/∂ ``src``, exact: (…, 2, 2)."""
    given, uv = _rows(src, 2)
    rays = pixel_rays(uv, camera, R, tolerance=0.0)
    slopes = pixel_rays_jacobian(uv, camera, R)
    return np.asarray(_plane_jacobian(rays, _matrix(P)) @ slopes).reshape(*given, 2, 2)


def undistortion_table(
    camera: VirtualCamera, R: ArrayLike | None = None, P: ArrayLike | None = None, *, tolerance: float = 1e-3
) -> Callable[[ArrayLike], Floats]:
    """:func:`undistort_points` as a function of ``src``, by a table with an error of at most ``tolerance`` px."""
    sight, turn, matrix = tabulated_sight(virtual(camera), tolerance), _rotation(R), _matrix(P)

    def table(src: ArrayLike) -> Floats:
        given, uv = _rows(src, 2)
        return _shaped(_undistorted(uv, sight, turn, matrix), given, 2)

    return table


def distort_points(
    undistorted: ArrayLike,
    camera: VirtualCamera,
    R: ArrayLike | None = None,
    P: ArrayLike | None = None,
    *,
    tolerance: float = TOLERANCE,
) -> Floats:
    """Pixels (…, 2) of the image that show ideal pinhole points: the inverse of :func:`undistort_points`.

    ``undistorted`` (…, 2) are normalised, or px where ``P`` is given, as there.
    """
    given, plane = _rows(undistorted, 2)
    directions = homogeneous(plane) @ np.linalg.inv(_matrix(P)).T @ _rotation(R)
    return _shaped(_project(camera, directions, tolerance), given, 2)


def distort_points_jacobian(
    undistorted: ArrayLike, camera: VirtualCamera, R: ArrayLike | None = None, P: ArrayLike | None = None
) -> Floats:
    """∂ :func:`distort_points`/∂ ``undistorted``, exact: (…, 2, 2)."""
    given, plane = _rows(undistorted, 2)
    by_plane = _rotation(R).T @ np.linalg.inv(_matrix(P))
    directions = homogeneous(plane) @ by_plane.T
    by_direction = _projection_jacobian(camera, _project(camera, directions, 0.0), directions)
    return np.asarray(by_direction @ by_plane[:, :2]).reshape(*given, 2, 2)


def pixel_rays(
    src: ArrayLike, camera: VirtualCamera, R: ArrayLike | None = None, *, tolerance: float = TOLERANCE
) -> Floats:
    """Unit directions (…, 3) of the rays of the pixels ``src`` (…, 2)."""
    given, uv = _rows(src, 2)
    turn = _rotation(R)
    rays = _sight(camera, len(uv), tolerance).map(uv, np.empty((len(uv), 3)), lambda rays: rays @ turn.T)
    return _shaped(rays, given, 3)


def pixel_rays_jacobian(src: ArrayLike, camera: VirtualCamera, R: ArrayLike | None = None) -> Floats:
    """∂ :func:`pixel_rays`/∂ ``src``, exact: (…, 3, 2) per px."""
    given, uv = _rows(src, 2)
    jacobian = np.full((len(uv), 3, 2), np.nan)
    known = np.isfinite(uv).all(axis=1)
    if known.any():
        q = virtual(camera).plane_map.value(uv[known])
        jacobian[known] = camera.chart.direction_jacobian(q) @ camera.plane_map.jacobian(uv[known])
    return np.asarray(_rotation(R) @ jacobian).reshape(*given, 3, 2)


def project_points(
    objectPoints: ArrayLike, rvec: ArrayLike, tvec: ArrayLike, camera: VirtualCamera, R: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """Pixels (…, 2) of ``objectPoints`` (…, 3) at the pose ``rvec`` (3,), ``tvec`` (3,), like ``cv2.projectPoints``.

    The second result is their derivative (2N, 6) by rvec and tvec, with alternating rows u and v; OpenCV's further
    columns, for the parameters of its lens model, have no counterpart. ``tvec`` is in the unit of the points.
    """
    given, points = _rows(objectPoints, 3)
    vector, turn = _vector(rvec, "rvec"), _rotation(R)
    turned, xyz = _posed(points, vector, _vector(tvec, "tvec"), turn)
    uv = _project(camera, xyz, 0.0)
    by_point = _projection_jacobian(camera, uv, xyz)
    by_turn = np.cross(turned[:, None, :], by_point) @ turn.T @ _left_jacobian(vector)
    jacobian = np.concatenate([by_turn, by_point @ turn.T], axis=2)
    return _shaped(uv, given, 2), jacobian.reshape(-1, 6)


def project_points_jacobian(
    objectPoints: ArrayLike, rvec: ArrayLike, tvec: ArrayLike, camera: VirtualCamera, R: ArrayLike | None = None
) -> Floats:
    """∂ :func:`project_points`/∂ ``objectPoints``, exact: (…, 2, 3) px per unit of the points."""
    given, points = _rows(objectPoints, 3)
    vector, turn = _vector(rvec, "rvec"), _rotation(R)
    xyz = _posed(points, vector, _vector(tvec, "tvec"), turn)[1]
    by_point = _projection_jacobian(camera, _project(camera, xyz, 0.0), xyz)
    return np.asarray(by_point @ turn.T @ Rotation.from_rotvec(vector).as_matrix()).reshape(*given, 2, 3)


def solve_pnp(
    objectPoints: ArrayLike, imagePoints: ArrayLike, camera: VirtualCamera, R: ArrayLike | None = None
) -> tuple[bool, Floats, Floats]:
    """The pose of ``objectPoints`` (…, 3) seen at the pixels ``imagePoints`` (…, 2), like ``cv2.solvePnP``.

    Returns True, rvec (3, 1), and tvec (3, 1) in the unit of the points. The pose minimises the squared residuals in
    px, for coplanar points or not, and for any field of view. Points and pixels that are nan, and pixels without a ray,
    are left out. Raises InputError for fewer than four others, if the numbers of points and pixels differ, and if the
    points do not determine a pose.
    """
    points, uv = _rows(objectPoints, 3)[1], _rows(imagePoints, 2)[1]
    if len(points) != len(uv):
        raise InputError(f"{len(points)} points and {len(uv)} pixels were given; each point needs its pixel")
    known: Bools = np.asarray(np.isfinite(points).all(axis=1) & np.isfinite(uv).all(axis=1))
    known[known] = _have_rays(virtual(camera), uv[known])
    if known.sum() < FEWEST_POINTS:
        raise InputError(
            f"a pose needs {FEWEST_POINTS} points whose pixels have rays, and {known.sum()} of {len(points)} do; give "
            "more of them, inside the camera's domain"
        )
    seen = sighting_of(camera, points[known], uv[known])
    start = _first_pose(points[known], camera.chart.directions(seen.coordinates))
    pose, _ = refine_pose(seen, start, camera.chart)
    turn = _rotation(R)
    rvec = Rotation.from_matrix(turn @ pose.rotation).as_rotvec()
    return True, rvec.reshape(3, 1), (turn @ pose.translation).reshape(3, 1)


def _have_rays(camera: VirtualCamera, uv: Floats) -> Bools:
    """Which (n,) of the pixels ``uv`` (n, 2) have a ray, and another one beside them."""
    slopes = inverse_2x2(camera.plane_map.jacobian(uv))
    return np.asarray(np.isfinite(camera.plane_map.value(uv)).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2)))


def _first_pose(points: Floats, directions: Floats) -> Pose:
    """A pose by SQPnP (Terzakis & Lourakis, 2020) in a plane across the mean ray, with the points scaled to size 1."""
    import cv2

    middle = points.mean(axis=0)
    scale = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean()))
    if np.linalg.matrix_rank(points - middle, tol=1e-9 * scale) < 2:
        raise InputError("the points lie on one line, which does not determine a pose; give points that span a plane")
    turn = Rotation.align_vectors([[0.0, 0.0, 1.0]], [directions.mean(axis=0)])[0].as_matrix()
    local = directions @ turn.T
    usable = local[:, 2] > LEAST_COSINE
    if usable.sum() < FEWEST_POINTS:
        raise InputError(
            f"fewer than {FEWEST_POINTS} pixels are within 80 degrees of their mean direction, so that no initial pose "
            "can be found; give pixels from a smaller part of the image"
        )
    plane, normalised = local[usable, :2] / local[usable, 2:], (points[usable] - middle) / scale
    try:
        _, rvec, tvec = cv2.solvePnP(normalised, plane, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
    except cv2.error:
        raise InputError("the points do not determine a pose; give more of them, farther apart") from None
    rotation = turn.T @ Rotation.from_rotvec(rvec[:, 0]).as_matrix()
    return Pose(rotation, scale * (turn.T @ tvec[:, 0]) - rotation @ middle)


# --- parts -------------------------------------------------------------------------------------------------------


def _rows(values: ArrayLike, dimensions: int) -> tuple[tuple[int, ...], Floats]:
    """The shape of ``values`` without its last axis, and the points as rows (N, dimensions)."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"the points are not all numbers in rows of {dimensions}; give an array of numbers") from None
    if array.ndim < 1 or array.shape[-1] != dimensions:
        raise InputError(
            f"points of shape {array.shape} were given where (N, {dimensions}), (N, 1, {dimensions}) or "
            f"(1, N, {dimensions}) is needed; check the last axis"
        )
    return array.shape[:-1], array.reshape(-1, dimensions)


def _shaped(rows: Floats, given: tuple[int, ...], dimensions: int) -> Floats:
    return rows.reshape(*given, dimensions)


def _rotation(R: ArrayLike | None) -> Floats:
    matrix = np.eye(3) if R is None else np.asarray(R, dtype=np.float64)
    if matrix.shape != (3, 3):
        raise InputError(f"R of shape {matrix.shape} was given where a matrix (3, 3) is needed; see cv2.Rodrigues")
    return matrix


def _matrix(P: ArrayLike | None) -> Floats:
    matrix = np.eye(3) if P is None else np.asarray(P, dtype=np.float64)
    if matrix.shape not in ((3, 3), (3, 4)):
        raise InputError(f"P of shape {matrix.shape} was given where (3, 3) or (3, 4) is needed; give a camera matrix")
    if not np.linalg.det(matrix[:, :3]):
        raise InputError("P has no inverse; give a camera matrix, with focal lengths other than 0")
    return matrix[:, :3]


def _vector(values: ArrayLike, name: str) -> Floats:
    """``rvec`` or ``tvec`` as (3,)."""
    vector = np.asarray(values, dtype=np.float64)
    if vector.size != 3:
        raise InputError(f"{name} of shape {vector.shape} was given where (3,), (3, 1) or (1, 3) is needed")
    return vector.ravel()


def _sight(camera: VirtualCamera, count: int, tolerance: float) -> Sight:
    """The camera's own map, or for many pixels its table."""
    many = count >= MANY and tolerance > 0.0
    return tabulated_sight(virtual(camera), tolerance) if many else exact_sight(virtual(camera))


def _undistorted(uv: Floats, sight: Sight, turn: Floats, matrix: Floats) -> Floats:
    return sight.map(uv, np.empty_like(uv), lambda rays: _on_plane((turn @ rays.T).T, matrix))


def _on_plane(rays: Floats, matrix: Floats) -> Floats:
    """Points (n, 2) of the plane of ``matrix`` (3, 3) that unit ``rays`` (n, 3) meet; nan for those that do not."""
    x, y, w = matrix @ rays.T
    with np.errstate(invalid="ignore"):
        w[~(rays[:, 2] > 0)] = np.nan
    return np.stack([x / w, y / w], axis=1)


def _plane_jacobian(rays: Floats, matrix: Floats) -> Floats:
    """Derivative (n, 2, 3) of :func:`_on_plane`."""
    numerator = _on_plane(rays, matrix)[:, :, None] * matrix[2]
    return np.asarray((matrix[:2] - numerator) / (rays @ matrix[2])[:, None, None])


def _posed(points: Floats, vector: Floats, shift: Floats, turn: Floats) -> tuple[Floats, Floats]:
    """``points`` (n, 3) rotated into the camera's frame, and rotated and shifted."""
    turned = points @ (turn.T @ Rotation.from_rotvec(vector).as_matrix()).T
    return turned, turned + turn.T @ shift


def _project(camera: VirtualCamera, xyz: Floats, tolerance: float) -> Floats:
    if len(xyz) >= MANY and tolerance > 0.0:
        return tabulated_pixels(virtual(camera), xyz, tolerance)
    return virtual(camera).project(xyz) if len(xyz) else np.empty((0, 2))


def _projection_jacobian(camera: VirtualCamera, uv: Floats, xyz: Floats) -> Floats:
    """∂uv/∂xyz (n, 2, 3) at points ``xyz`` (n, 3) seen at ``uv`` (n, 2); nan where they are not visible."""
    jacobian = np.full((len(uv), 2, 3), np.nan)
    known = np.isfinite(uv).all(axis=1)
    if known.any():
        by_pixel = camera.plane_map.jacobian(uv[known])
        jacobian[known] = inverse_2x2(by_pixel) @ camera.chart.coordinate_jacobian(xyz[known])
    return jacobian


def _left_jacobian(vector: Floats) -> Floats:
    """The left Jacobian (3, 3) of a rotation vector (3,): exp(v + dv) = exp(J dv) exp(v) to first order.

    J = 1 + (1 − cos θ)/θ² [v]× + (θ − sin θ)/θ³ [v]×², θ = |v| (Chirikjian, *Stochastic Models*, vol. 2, 10.6).
    """
    theta = float(np.linalg.norm(vector))
    cross: Any = np.cross(np.eye(3), vector)
    if theta < 1e-4:
        return np.asarray(np.eye(3) + cross / 2.0 + cross @ cross / 6.0)
    first = (1.0 - np.cos(theta)) / theta**2
    return np.asarray(np.eye(3) + first * cross + (theta - np.sin(theta)) / theta**3 * cross @ cross)
