"""Poses from directions in closed form, and least squares of a pose, or of K with all poses.

The least squares are solved by Levenberg-Marquardt with the poses eliminated. Residuals are in px of the original
image: each difference of virtual points or rays is multiplied by its corner's whitening, the inverse of the map's
Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.arrays import Floats, Ints
from pinholify.charts import Chart, Intrinsics, PlaneChart
from pinholify.geometry import POSE_DOF, Pose, nearest_rotation

MAX_STEPS = 50
RELATIVE_TOLERANCE = 1e-10  # decrease of the cost, relative to it, that ends the descent
FIRST_DAMPING = 1e-4  # of Levenberg-Marquardt, relative to the diagonal of the normal equations
DAMPING_FACTOR = 10.0
MAX_DAMPING = 1e8  # beyond it steps are too short to matter


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """Points of one board and where the camera sees them.

    ``target`` are the board's points in squares, (n, 2) on its plane or (n, 3) solid, ``coordinates`` (n, 2) those of
    their rays in a chart, and ``whitening`` (n, 2, 2) turns a difference of coordinates into px times the corner's
    weight.
    """

    target: Floats
    coordinates: Floats
    whitening: Floats


def poses_of_directions(directions: Floats, lattice: Floats, starts: Ints) -> tuple[Floats, Floats]:
    """Poses, (K, 3, 3) and (K, 3) in squares, of flat boards from the ``directions`` (N, 3) of their corners.

    ``lattice`` (N, 2) are the corners in squares, sorted by board, and ``starts`` (K,) each board's first one. The
    direct linear transform solves d × (r₁ X + r₂ Y + t) = 0, with the sign that puts the points along the directions,
    and takes the nearest rotation; it works beyond 90° too. A board of too few corners gets a meaningless pose, not an
    error.
    """
    size = float(np.abs(lattice).max())
    points = np.column_stack([lattice / size, np.ones(len(lattice))])
    view = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(lattice)))
    d = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    products = (points[:, :, None] * points[:, None, :])[:, :, None, :, None] * across[:, None, :, None, :]
    of_boards = np.add.reduceat(products, starts, axis=0).reshape(-1, 9, 9)
    columns = np.linalg.eigh(of_boards)[1][:, :, 0].reshape(-1, 3, 3)  # rows: r₁, r₂, t up to scale
    along = np.add.reduceat(np.einsum("ni,nij,nj->n", points, columns[view], d), starts)
    columns = columns * np.where(along < 0, -1.0, 1.0)[:, None, None]
    lengths = np.linalg.norm(columns[:, :2], axis=2).mean(axis=1)[:, None]
    first, second = columns[:, 0] / lengths, columns[:, 1] / lengths
    rotations = nearest_rotation(np.stack([first, second, np.cross(first, second)], axis=2))
    return rotations, columns[:, 2] / lengths * size


def pose_residuals(sighting: Sighting, pose: Pose, chart: Chart) -> tuple[Floats, Floats]:
    """Residuals (2n,) in px, and their derivative (2n, 6) by a rotation about the camera's axes and a translation."""
    turned = sighting.target @ pose.rotation[:, : sighting.target.shape[1]].T
    points = turned + pose.translation
    by_point = sighting.whitening @ chart.coordinate_jacobian(points)
    residual = sighting.whitening @ (chart.coordinates(points) - sighting.coordinates)[:, :, None]
    jacobian = np.concatenate([_cross_columns(by_point, turned), by_point], axis=2)
    return residual.ravel(), jacobian.reshape(-1, POSE_DOF)


def _cross_columns(by_point: Floats, turned: Floats) -> Floats:
    """Derivative by a rotation vector ω, which moves a point p by ω × p: row · (ω × p) = (p × row) · ω."""
    return np.cross(turned[:, None, :], by_point)


def moved(pose: Pose, step: Floats) -> Pose:
    """``pose`` rotated by the rotation vector ``step[:3]`` and shifted by ``step[3:]``, ``step`` (6,)."""
    return Pose(Rotation.from_rotvec(step[:3]).as_matrix() @ pose.rotation, pose.translation + step[3:])


class _Fit(Protocol):
    """A point of the descent, with the sum of squares there."""

    @property
    def cost(self) -> float: ...


_AnyFit = TypeVar("_AnyFit", bound=_Fit)


def _damped_descent(start: _AnyFit, stepped: Callable[[_AnyFit, float], _AnyFit]) -> _AnyFit:
    """The minimum of the cost near ``start``; ``stepped`` takes the damped Gauss-Newton step from a fit."""
    best, damping = start, FIRST_DAMPING
    for _ in range(MAX_STEPS):
        trial = stepped(best, damping)
        if not trial.cost < best.cost:  # also where the trial is nan
            damping *= DAMPING_FACTOR
            if damping > MAX_DAMPING:
                break
            continue
        small = best.cost - trial.cost <= RELATIVE_TOLERANCE * best.cost
        best, damping = trial, damping / DAMPING_FACTOR
        if small:
            break
    return best


@dataclass(frozen=True, slots=True, eq=False)
class _PoseFit:
    """A pose with the residuals (2n,) there and their derivative (2n, 6)."""

    pose: Pose
    residual: Floats
    jacobian: Floats
    cost: float


def refine_pose(sighting: Sighting, pose: Pose, chart: Chart) -> tuple[Pose, Floats]:
    """The pose of least squared px residuals near ``pose``, and its covariance (6, 6) at 1 px of noise per axis."""

    def measured(pose: Pose) -> _PoseFit:
        residual, jacobian = pose_residuals(sighting, pose, chart)
        return _PoseFit(pose, residual, jacobian, float(residual @ residual))

    def stepped(fit: _PoseFit, damping: float) -> _PoseFit:
        normal = fit.jacobian.T @ fit.jacobian
        damped = normal + damping * np.diag(np.diag(normal))
        return measured(moved(fit.pose, np.asarray(np.linalg.solve(damped, -fit.jacobian.T @ fit.residual))))

    best = _damped_descent(measured(pose), stepped)
    return best.pose, np.asarray(np.linalg.pinv(best.jacobian.T @ best.jacobian))


@dataclass(frozen=True, slots=True, eq=False)
class PlaneRefinement:
    """K, and the poses of all boards, of least squared px residuals in the virtual plane."""

    intrinsics: Intrinsics
    poses: tuple[Pose, ...]


def refine_intrinsics(
    sightings: Sequence[Sighting], intrinsics: Intrinsics, poses: Sequence[Pose]
) -> PlaneRefinement:
    """(f, uc, vc) and the poses of all boards together, from ``intrinsics`` and ``poses``.

    The coordinates of ``sightings`` are virtual points, in squares. The reference board's pose is known in this frame
    (R = I, t = (−uc, −vc, f)), so it must not be among the boards.
    """

    def stepped(fit: _PlaneFit, damping: float) -> _PlaneFit:
        step_k, steps = _eliminated_step(fit, damping)
        return _linearised(sightings, fit.k + step_k, [moved(*each) for each in zip(fit.poses, steps, strict=True)])

    k = np.array([intrinsics.f, intrinsics.uc, intrinsics.vc])
    best = _damped_descent(_linearised(sightings, k, poses), stepped)
    return PlaneRefinement(Intrinsics(*(float(x) for x in best.k)), tuple(best.poses))


@dataclass(frozen=True, slots=True, eq=False)
class Influence:
    """The influence of each board on K = (f, uc, vc), to first order around the least-squares solution.

    ``responses`` are ∂K/∂(shift of the board's corners in px, times their weights), (3, 2n) per board; ``left_out``
    (boards, 3) is how K changes when one board is left out, nan where the others do not determine it.
    """

    responses: tuple[Floats, ...]
    left_out: Floats

    @property
    def jackknife_std(self) -> Floats | None:
        """Standard deviations (3,) of K by leaving out one board at a time; None below four boards (Efron 1982)."""
        n = len(self.left_out)
        if n < 4 or not np.isfinite(self.left_out).all():
            return None
        return np.asarray(np.sqrt((n - 1) / n * ((self.left_out - self.left_out.mean(axis=0)) ** 2).sum(axis=0)))


def influence_on_intrinsics(
    sightings: Sequence[Sighting], intrinsics: Intrinsics, poses: Sequence[Pose]
) -> Influence:
    """How the K found by :func:`refine_intrinsics` depends on each board, at the ``intrinsics`` and ``poses`` found."""
    free, pulls = [], []
    for sighting, pose in zip(sightings, poses, strict=True):
        by_k, by_pose, residual = _derivatives(sighting, pose, intrinsics)
        basis = np.linalg.qr(by_pose)[0]
        free.append(by_k - basis @ (basis.T @ by_k))  # what no change of pose can absorb
        pulls.append(free[-1].T @ residual)
    information = np.stack([rows.T @ rows for rows in free])
    whole = information.sum(axis=0)
    return Influence(
        tuple(np.linalg.solve(whole, rows.T) for rows in free),
        np.stack([_solved(whole - own, pull) for own, pull in zip(information, pulls, strict=True)]),
    )


def _solved(matrix: Floats, right: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.full(len(right), np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class _PlaneFit:
    """K and the poses, with the normal equations there, which have the shape of an arrow.

    Their blocks are ``by_k`` (3, 3), ``by_pose`` (n, 6, 6) and
    ``mixed`` (n, 3, 6); ``right_k`` (3,) and ``right_pose`` (n, 6) are the right-hand sides.
    """

    k: Floats
    poses: Sequence[Pose]
    by_k: Floats
    by_pose: Floats
    mixed: Floats
    right_k: Floats
    right_pose: Floats
    cost: float


def _linearised(sightings: Sequence[Sighting], k: Floats, poses: Sequence[Pose]) -> _PlaneFit:
    intrinsics = Intrinsics(*(float(x) for x in k))
    blocks = [_derivatives(*each, intrinsics) for each in zip(sightings, poses, strict=True)]
    return _PlaneFit(
        k,
        poses,
        np.sum([a.T @ a for a, _, _ in blocks], axis=0),
        np.stack([b.T @ b for _, b, _ in blocks]),
        np.stack([a.T @ b for a, b, _ in blocks]),
        np.sum([a.T @ r for a, _, r in blocks], axis=0),
        np.stack([b.T @ r for _, b, r in blocks]),
        float(sum(r @ r for _, _, r in blocks)) if intrinsics.f > 0.0 else np.inf,
    )


def _derivatives(sighting: Sighting, pose: Pose, intrinsics: Intrinsics) -> tuple[Floats, Floats, Floats]:
    """Derivatives of one board's residuals by K (2n, 3) and by its pose (2n, 6), and the residuals (2n,), px."""
    residual, by_pose = pose_residuals(sighting, pose, PlaneChart(intrinsics))
    by_k = intrinsics.parameter_jacobian(pose.apply(sighting.target))
    return (sighting.whitening @ by_k).reshape(-1, 3), by_pose, residual


def _eliminated_step(fit: _PlaneFit, damping: float) -> tuple[Floats, Floats]:
    """The damped Gauss-Newton step of K (3,) and the poses (n, 6), by Schur complement."""
    corner = fit.by_k + damping * np.diag(np.diag(fit.by_k))
    blocks = fit.by_pose + damping * np.eye(POSE_DOF) * np.diagonal(fit.by_pose, axis1=1, axis2=2)[:, None, :]
    to_pose = np.linalg.solve(blocks, fit.mixed.transpose(0, 2, 1))
    right = np.linalg.solve(blocks, fit.right_pose[:, :, None])[:, :, 0]
    schur = corner - np.einsum("nij,njk->ik", fit.mixed, to_pose)
    step_k = np.linalg.solve(schur, np.einsum("nij,nj->i", fit.mixed, right) - fit.right_k)
    return step_k, -right - to_pose @ step_k
