"""Plane and rotation geometry: grids, homographies, hulls, lines, rotations, poses and 2×2 systems.

Pure functions of float64 arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats, frozen

FARTHEST = 1e150
"""Coordinates below this have a square."""

# --- grids ------------------------------------------------------------------------------------------------------


def grid_points(x: Floats, y: Floats) -> Floats:
    """All points (k·m, 2) with a first coordinate of ``x`` (k,) and a second one of ``y`` (m,), row by row."""
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def image_grid(image_size: tuple[int, int], count: int, *, to_edges: bool = False) -> Floats:
    """``count`` × ``count`` pixels (n, 2) all over an image of ``image_size`` (width, height), row by row.

    The outermost are at the centres of its outermost pixels, or, ``to_edges``, half a px farther out.
    """
    margin = 0.5 if to_edges else 0.0
    u, v = (np.linspace(0.0 - margin, extent - 1.0 + margin, count) for extent in image_size)
    return grid_points(u, v)


# --- homographies -----------------------------------------------------------------------------------------------


def homogeneous(xy: Floats) -> Floats:
    """(N, d) points with a column of ones appended: (N, d+1)."""
    return np.concatenate([xy, np.ones((len(xy), 1))], axis=1)


def apply_homography(h: Floats, xy: Floats) -> Floats:
    """Points (N, 2) mapped by the homography ``h`` (3, 3)."""
    q = homogeneous(xy) @ h.T
    return q[:, :2] / q[:, 2:]


def homography_jacobian(h: Floats, xy: Floats) -> Floats:
    """Derivative (N, 2, 2) of :func:`apply_homography` with respect to the points."""
    q = homogeneous(xy) @ h.T
    mapped = q[:, :2] / q[:, 2:]
    return (h[None, :2, :2] - mapped[:, :, None] * h[None, 2:, :2]) / q[:, 2, None, None]


def homography_parameter_jacobian(h: Floats, xy: Floats) -> Floats:
    """Derivative (N, 2, 9) of :func:`apply_homography` with respect to the entries of ``h``, row by row."""
    q = homogeneous(xy)
    row = q / (q @ h[2])[:, None]
    jacobian = np.zeros((len(xy), 2, 9))
    jacobian[:, 0, 0:3] = jacobian[:, 1, 3:6] = row
    jacobian[:, :, 6:9] = -(row @ h[:2].T)[:, :, None] * row[:, None, :]
    return jacobian


def normalising_similarity(xy: Floats) -> Floats:
    """The similarity (3, 3) that brings points to zero mean and RMS distance √2 (Hartley & Zisserman, 4.4.4)."""
    mean = xy.mean(axis=0)
    rms = np.sqrt(((xy - mean) ** 2).sum(axis=1).mean())
    s = np.sqrt(2.0) / rms if rms > 0 else 1.0
    return np.array([[s, 0.0, -s * mean[0]], [0.0, s, -s * mean[1]], [0.0, 0.0, 1.0]])


def _dlt(source: Floats, target: Floats) -> Floats:
    x, y = source.T
    u, v = target.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows_u = np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=1)
    rows_v = np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=1)
    return np.asarray(np.linalg.svd(np.concatenate([rows_u, rows_v]), full_matrices=False)[2][-1].reshape(3, 3))


def estimate_homography(source: Floats, target: Floats, whitening: Floats | None = None) -> Floats:
    """The homography (3, 3) with h₃₃ = 1 that best maps ``source`` (N, 2) to ``target`` (N, 2), N ≥ 4.

    Normalised DLT, then Gauss-Newton on the distances in the target plane; ``whitening`` (N, 2, 2) multiplies each
    residual, e.g. to measure it in px of an image. Raises ValueError for fewer than four points.
    """
    if len(source) < 4:
        raise ValueError(f"a homography needs at least 4 points, {len(source)} were given")
    n_source, n_target = normalising_similarity(source), normalising_similarity(target)
    p, q = apply_homography(n_source, source), apply_homography(n_target, target)
    h = _dlt(p, q)
    h = h / np.linalg.norm(h)
    weight = np.broadcast_to(np.eye(2), (len(p), 2, 2)) if whitening is None else whitening / n_target[0, 0]
    for _ in range(10):
        step = _homography_step(h, p, q, weight)
        h = h + step
        h = h / np.linalg.norm(h)
        if np.linalg.norm(step) < 1e-13:
            break
    h = np.linalg.solve(n_target, h) @ n_source
    return np.asarray(h / h[2, 2])


def homography_response(h: Floats, source: Floats, whitening: Floats) -> Floats:
    """Derivative (9, 2N) of the least-squares homography ``h`` (h₃₃ = 1) with respect to its target points.

    ``source`` (N, 2) and ``whitening`` (N, 2, 2) are those of :func:`estimate_homography`.
    """
    weighted: Floats = np.reshape(whitening @ homography_parameter_jacobian(h, source)[:, :, :8], (-1, 8))
    scale = np.linalg.norm(weighted, axis=0)
    pseudo = (np.linalg.pinv(weighted / scale) / scale[:, None]).reshape(8, -1, 2)
    response = np.einsum("pni,nij->pnj", pseudo, whitening).reshape(8, -1)
    return np.concatenate([response, np.zeros((1, response.shape[1]))])


def _homography_step(h: Floats, p: Floats, q: Floats, weight: Floats) -> Floats:
    weighted: Floats = np.reshape(weight @ homography_parameter_jacobian(h, p), (-1, 9))
    residual = (weight @ (q - apply_homography(h, p))[:, :, None]).reshape(-1)
    # The scale of h is free; lstsq's minimum-norm solution leaves it alone.
    return np.asarray(np.linalg.lstsq(weighted, residual, rcond=1e-12)[0].reshape(3, 3))


# --- hulls and lines --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ConvexRegion:
    """The convex hull of points in a plane: ``vertices`` (n, 2) in counter-clockwise order, ``area``.

    Points that span no area give an empty region of area 0.
    """

    vertices: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen(self.vertices, (None, 2)))

    @property
    def area(self) -> float:
        """Enclosed area, in squared units of the points."""
        x, y = self.vertices.T
        return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)

    def contains(self, xy: Floats, margin: float = 0.0) -> Bools:
        """Whether each of ``xy`` (N, 2) lies inside, or outside by no more than ``margin``; not if it is not finite."""
        if len(self.vertices) < 3:
            return np.zeros(len(xy), dtype=bool)
        edges = np.roll(self.vertices, -1, axis=0) - self.vertices
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
        with np.errstate(invalid="ignore"):
            outside = xy @ normals.T - (self.vertices * normals).sum(axis=1)
        return np.asarray((outside <= margin + 1e-9 * np.sqrt(self.area)).all(axis=1))


def convex_hull(xy: Floats) -> ConvexRegion:
    """The convex hull of ``xy`` (N, 2)."""
    from scipy.spatial import ConvexHull, QhullError  # slow to load, and most users of this module do without

    try:
        hull = ConvexHull(xy)
    except (QhullError, ValueError):
        return ConvexRegion(np.empty((0, 2)))
    return ConvexRegion(xy[hull.vertices])


def line_distances(xy: Floats) -> Floats:
    """Perpendicular distances (N,) of ``xy`` (N, 2) to their total-least-squares line."""
    centred = xy - xy.mean(axis=0)
    return np.asarray(np.abs(centred @ np.linalg.svd(centred, full_matrices=False)[2][-1]))


# --- rotations and poses ----------------------------------------------------------------------------------------

POSE_DOF = 6  # three of the rotation, three of the translation


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """``camera_from_board``: the board point p is at R p + t in the camera frame; t in squares."""

    rotation: Floats
    translation: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3)))
        object.__setattr__(self, "translation", frozen(self.translation, (3,)))

    def apply(self, xyz: Floats) -> Floats:
        """Points (N, 3) of the board frame, or (N, 2) on its plane, in the camera frame: (N, 3)."""
        return xyz @ self.rotation[:, : xyz.shape[1]].T + self.translation


def nearest_rotation(matrix: Floats) -> Floats:
    """The rotations (..., 3, 3) nearest to ``matrix`` (..., 3, 3) in the Frobenius norm."""
    u, _, vt = np.linalg.svd(matrix)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return np.asarray(u @ vt)


def cross_matrices(vectors: Floats) -> Floats:
    """[v]× (n, 3, 3) of vectors (n, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def rotation_to_z(direction: Floats) -> Floats:
    """The shortest rotation (3, 3) that takes the unit ``direction`` (3,) to z; by a half turn about x where z < 0."""
    if direction[2] < 0.0:  # the shortest rotation is ill-conditioned near -z
        half_turn = np.diag([1.0, -1.0, -1.0])
        return rotation_to_z(half_turn @ direction) @ half_turn
    x, y, z = direction
    cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + z))


def rotation_about_z(angle: float) -> Floats:
    """The rotation (3, 3) that turns the axes by ``angle`` in radians about z: x to (cos, -sin, 0)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])


# --- 2×2 systems, many times faster than NumPy's general routines -----------------------------------------------


def solve_2x2(matrices: Floats, right: Floats) -> Floats:
    """Solutions (n, 2) of ``matrices`` (n, 2, 2) s = ``right`` (n, 2); not finite where a matrix is singular."""
    (a, b), (c, d) = matrices.transpose(1, 2, 0)
    p, q = right.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.stack([d * p - b * q, a * q - c * p], axis=1) / (a * d - b * c)[:, None])


def inverse_2x2(matrices: Floats) -> Floats:
    """Inverses of ``matrices`` (n, 2, 2); not finite where a matrix is singular."""
    return inverse_of_parts(matrices.transpose(1, 2, 0)).transpose(2, 0, 1)


def inverse_of_parts(matrices: Floats) -> Floats:
    """Inverses of ``matrices`` (2, 2, n); not finite where a matrix is singular."""
    (a, b), (c, d) = matrices
    inverse = np.empty((2, 2, len(a)))
    inverse[0, 0], inverse[0, 1], inverse[1, 0], inverse[1, 1] = d, -b, -c, a
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse /= a * d - b * c
    return inverse
