"""Poses, and K with poses, refined by least squares: Levenberg-Marquardt with the poses eliminated.

Residuals are measured in px of the original image, by each corner's whitening: the inverse of the map's Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.arrays import Floats
from pinholify.charts import Chart, Intrinsics, PlaneChart
from pinholify.geometry import Pose

STEPS = 50
CONVERGED = 1e-10  # relative decrease of the cost


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What the camera saw of one board: its points ``target`` in squares, (n, 2) on its plane or (n, 3) solid,
    their ``coordinates`` (n, 2) of the chart, and ``whitening`` (n, 2, 2) that turns a difference of coordinates into
    px (times the corner's weight).
    """

    target: Floats
    coordinates: Floats
    whitening: Floats


def pose_residuals(sighting: Sighting, pose: Pose, chart: Chart) -> tuple[Floats, Floats]:
    """Residuals (2n,) in px, and their derivative (2n, 6) by a turn about the camera axes and a shift."""
    turned = sighting.target @ pose.rotation[:, : sighting.target.shape[1]].T
    points = turned + pose.translation
    by_point = sighting.whitening @ chart.coordinate_jacobian(points)
    residual = sighting.whitening @ (chart.coordinates(points) - sighting.coordinates)[:, :, None]
    jacobian = np.concatenate([_cross_columns(by_point, turned), by_point], axis=2)
    return residual.ravel(), jacobian.reshape(-1, 6)


def _cross_columns(by_point: Floats, turned: Floats) -> Floats:
    """Derivative by a rotation vector ω, which moves a point p by ω × p: row · (ω × p) = (p × row) · ω."""
    return np.cross(turned[:, None, :], by_point)


def moved(pose: Pose, step: Floats) -> Pose:
    """``pose`` turned by the rotation vector ``step[:3]`` and shifted by ``step[3:]``."""
    return Pose(Rotation.from_rotvec(step[:3]).as_matrix() @ pose.rotation, pose.translation + step[3:])


def refine_pose(sighting: Sighting, pose: Pose, chart: Chart) -> tuple[Pose, Floats]:
    """The pose of least squared px residuals near ``pose``, and its covariance (6, 6) at 1 px of noise per axis."""
    residual, jacobian = pose_residuals(sighting, pose, chart)
    cost, damping = float(residual @ residual), 1e-4
    for _ in range(STEPS):
        normal = jacobian.T @ jacobian
        step: Floats = np.asarray(
            np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -jacobian.T @ residual), dtype=np.float64
        )
        trial = moved(pose, step)
        trial_residual, trial_jacobian = pose_residuals(sighting, trial, chart)
        trial_cost = float(trial_residual @ trial_residual)
        if not trial_cost < cost:  # also where the trial is nan
            damping *= 10.0
            if damping > 1e8:
                break
            continue
        small = cost - trial_cost <= CONVERGED * cost
        pose, residual, jacobian, cost, damping = trial, trial_residual, trial_jacobian, trial_cost, damping / 10.0
        if small:
            break
    return pose, np.asarray(np.linalg.pinv(jacobian.T @ jacobian))


@dataclass(frozen=True, slots=True, eq=False)
class PlaneRefinement:
    """K and poses of least squared px residuals in the virtual plane."""

    intrinsics: Intrinsics
    poses: tuple[Pose, ...]


def refine_intrinsics(
    sightings: Sequence[Sighting], intrinsics: Intrinsics, poses: Sequence[Pose]
) -> PlaneRefinement:
    """(f, uc, vc) and the ``poses`` of all boards together; coordinates are those of the virtual plane.

    The reference board's pose is known in this frame (R = I, t = (−uc, −vc, f)), so it must not be among the boards.
    """
    k, current = np.array([intrinsics.f, intrinsics.uc, intrinsics.vc]), list(poses)
    system = _linearise(sightings, k, current)
    damping = 1e-4
    for _ in range(STEPS):
        step_k, steps = _eliminated_step(system, damping)
        trial_k, trial = k + step_k, [moved(p, s) for p, s in zip(current, steps, strict=True)]
        trial_system = _linearise(sightings, trial_k, trial)
        if trial_k[0] <= 0 or not trial_system.cost < system.cost:
            damping *= 10.0
            if damping > 1e8:
                break
            continue
        small = system.cost - trial_system.cost <= CONVERGED * system.cost
        k, current, system, damping = trial_k, trial, trial_system, damping / 10.0
        if small:
            break
    return PlaneRefinement(Intrinsics(*(float(x) for x in k)), tuple(current))


@dataclass(frozen=True, slots=True, eq=False)
class Influence:
    """What K = (f, uc, vc) owes to each board, to first order around the least squares.

    ``responses`` are ∂K/∂(shift of the board's corners in px, times their weights), (3, 2n) a board; ``left_out``
    (boards, 3) is how K moves where one board is left out, nan where the others do not determine it.
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
    """How the K that :func:`refine_intrinsics` finds depends on the boards, at what it found."""
    free, pulls = [], []
    for sighting, pose in zip(sightings, poses, strict=True):
        by_k, by_pose, residual = _derivatives(sighting, pose, intrinsics)
        basis = np.linalg.qr(by_pose)[0]
        free.append(by_k - basis @ (basis.T @ by_k))  # what no pose can make good
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
class _Arrow:
    """Normal equations shaped like an arrow: K (3, 3), poses (n, 6, 6), between them (n, 3, 6), and right sides."""

    intrinsics: Floats
    poses: Floats
    mixed: Floats
    right_intrinsics: Floats
    right_poses: Floats
    cost: float


def _linearise(sightings: Sequence[Sighting], k: Floats, poses: Sequence[Pose]) -> _Arrow:
    intrinsics = Intrinsics(*(float(x) for x in k))
    blocks = [_derivatives(*each, intrinsics) for each in zip(sightings, poses, strict=True)]
    return _Arrow(
        np.sum([a.T @ a for a, _, _ in blocks], axis=0),
        np.stack([b.T @ b for _, b, _ in blocks]),
        np.stack([a.T @ b for a, b, _ in blocks]),
        np.sum([a.T @ r for a, _, r in blocks], axis=0),
        np.stack([b.T @ r for _, b, r in blocks]),
        float(sum(r @ r for _, _, r in blocks)),
    )


def _derivatives(sighting: Sighting, pose: Pose, intrinsics: Intrinsics) -> tuple[Floats, Floats, Floats]:
    """Of one board: the residuals' derivatives by K (2n, 3) and by its pose (2n, 6), and the residuals (2n,), px."""
    residual, by_pose = pose_residuals(sighting, pose, PlaneChart(intrinsics))
    directions = pose.apply(sighting.target)
    shape = (directions[:, :2] / directions[:, 2:])[:, :, None]
    by_k = np.concatenate([shape, np.broadcast_to(np.eye(2), (len(shape), 2, 2))], axis=2)
    return (sighting.whitening @ by_k).reshape(-1, 3), by_pose, residual


def _eliminated_step(system: _Arrow, damping: float) -> tuple[Floats, Floats]:
    """The damped Gauss-Newton step of K (3,) and the poses (n, 6), by Schur complement."""
    corner = system.intrinsics + damping * np.diag(np.diag(system.intrinsics))
    blocks = system.poses + damping * np.eye(6) * np.diagonal(system.poses, axis1=1, axis2=2)[:, None, :]
    to_pose = np.linalg.solve(blocks, system.mixed.transpose(0, 2, 1))
    right = np.linalg.solve(blocks, system.right_poses[:, :, None])[:, :, 0]
    schur = corner - np.einsum("nij,njk->ik", system.mixed, to_pose)
    step_k = np.linalg.solve(schur, np.einsum("nij,nj->i", system.mixed, right) - system.right_intrinsics)
    return step_k, -right - to_pose @ step_k
