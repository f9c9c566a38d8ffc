"""Diagnosis of a finished camera: structure in the residuals, suspicious boards, and where the next board helps most.

Pure functions of residuals, such as those of a :class:`~pinholify.refinement.result.JointResult`, and their corners.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.special import gammaincc, ndtr  # scipy.stats would take longer to import than to use

from pinholify.arrays import Bools, Floats, Ints, frozen
from pinholify.board import Board, lattice, outline
from pinholify.camera import VirtualCamera
from pinholify.corners import CornerSet
from pinholify.geometry import POSE_DOF, Pose, cross_matrices, grid_points, image_grid, inverse_2x2
from pinholify.gp.maps import PlaneMap

NEIGHBOURS = 8  # of each corner, in the test of structure
GRID_POINTS = 12  # along each side of the image, over which the next board's gain is averaged
SAMPLED_CORNERS = 45  # at least, of a board that may be next; each stands for several
SUSPICIOUS_P_VALUE = 1e-4  # of a board's misfit, once corrected for the number of boards
MAX_TILT_RAD = 0.6  # of a next board, about each axis


class Residuals(Protocol):
    """Residuals (n, 2) px and inlier masks (n,) of the corners of each used view, by name, and their noise."""

    @property
    def residuals(self) -> Mapping[str, Floats]:
        """Residuals (n, 2) px by view name."""
        ...

    @property
    def inliers(self) -> Mapping[str, Bools]:
        """Masks (n,) of the corners that count, by view name."""
        ...

    @property
    def noise_px(self) -> float:
        """Standard deviation of a corner of weight one, px per axis."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """The correlation of residuals that are close together in the image.

    ``correlation`` is the mean product of a whitened residual with its neighbours' (0: independent, 1: equal),
    ``p_value`` the probability of as much or more where there is no structure.
    """

    correlation: float
    p_value: float


def residual_structure(result: Residuals, corners: CornerSet) -> Structure:
    """Moran's I of the whitened inlier residuals over the nearest corners of *other* boards (Moran 1950).

    What a camera model lacks shows in several boards alike, while a board's own error (its pose, its bow) does not;
    hence only other boards count. The null distribution turns all residuals of a board by the same random angle, which
    preserves the correlation within a board.
    """
    uv, whitened, board = _inliers(result, corners)
    first, second = _pairs_across_boards(uv, board)
    if not len(first):
        return Structure(0.0, 1.0)
    z = whitened[:, 0] + 1j * whitened[:, 1]
    count = int(board.max()) + 1
    products = np.zeros((count, count), dtype=complex)  # of neighbours, summed for each pair of boards
    np.add.at(products, (board[first], board[second]), np.conj(z[first]) * z[second])
    # Turned by angles α, the sum is Σ Re exp(i(α_b − α_a)) products_ab; angles of different pairs are uncorrelated.
    null_std = 0.5 * float(np.linalg.norm(products + np.conj(products.T)))
    observed = float(products.sum().real)
    power = float((whitened**2).sum(axis=1).mean()) * len(first)
    return Structure(observed / power, float(ndtr(-observed / null_std)))


def _inliers(result: Residuals, corners: CornerSet) -> tuple[Floats, Floats, Ints]:
    """Pixels (n, 2), residuals (n, 2) in standard deviations, and board indices (n,) of all inliers."""
    used = [view for view in corners.views if view.name in result.residuals]
    uv, whitened, board = [], [], []
    for k, view in enumerate(used):
        keep = result.inliers[view.name]
        uv.append(view.uv[keep])
        whitened.append(result.residuals[view.name][keep] * view.weights[keep, None] / result.noise_px)
        board.append(np.full(int(keep.sum()), k))
    return np.concatenate(uv), np.concatenate(whitened), np.concatenate(board)


def _pairs_across_boards(uv: Floats, board: Ints) -> tuple[Ints, Ints]:
    """Indices of the corners and of their near neighbours on other boards, (pairs,) each."""
    near = cKDTree(uv).query(uv, k=range(1, min(NEIGHBOURS + 1, len(uv)) + 1))[1][:, 1:]  # the first is itself
    first = np.repeat(np.arange(len(uv)), near.shape[1])
    second = near.ravel()
    across = board[first] != board[second]
    return first[across], second[across]


@dataclass(frozen=True, slots=True)
class BoardSuspicion:
    """The ``ratio`` of a board's RMS residual to the noise, and the ``p_value`` of a larger one by chance."""

    name: str
    ratio: float
    p_value: float


def suspicious_boards(result: Residuals, corners: CornerSet) -> list[BoardSuspicion]:
    """Used boards whose residuals are too large for the noise, worst first.

    The test is the χ² of their inliers, less the six degrees of freedom of the pose, corrected for the number of boards
    (Bonferroni). Boards that were not used at all are in ``result.dropped`` with the reason.
    """
    found = []
    for view in corners.views:
        if view.name not in result.residuals:
            continue
        keep = result.inliers[view.name]
        whitened = result.residuals[view.name][keep] * view.weights[keep, None] / result.noise_px
        freedom = max(whitened.size - POSE_DOF, 1)
        misfit = float((whitened**2).sum())
        p_value = min(1.0, float(gammaincc(freedom / 2.0, misfit / 2.0)) * len(result.residuals))
        if p_value < SUSPICIOUS_P_VALUE:
            found.append(BoardSuspicion(view.name, float(np.sqrt(misfit / freedom)), p_value))
    return sorted(found, key=lambda suspicion: -suspicion.ratio)


@dataclass(frozen=True, slots=True, eq=False)
class NextBoard:
    """A place for the next board: its ``pose``, its ``outline`` (n, 2) px in the image, and its benefit.

    ``tilt_deg`` is the angle at its middle between its normal and the line of sight. ``std_before`` and
    ``std_after`` are the RMS of the predicted standard deviation over the image, in px.
    """

    pose: Pose
    outline: Floats
    tilt_deg: float
    std_before: float
    std_after: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "outline", frozen(self.outline, (None, 2)))


def next_board(
    camera: VirtualCamera,
    board: Board,
    known: Mapping[str, Pose],
    *,
    weight: float = 1.0,
    targets: int = 5,
    seed: int = 0,
) -> NextBoard | None:
    """The place where one more photograph of the board would lower the predicted variance over the image most.

    Boards are tried at the distances of the ``known`` ones, aimed at ``targets`` × ``targets`` pixels, with tilts that
    people manage and corners of the ``weight`` given. For each, the posterior with its corners is computed (Bayesian
    experimental design; that needs no measurement). Pixels where the map has no ray do not count, and no corner is
    placed there. None where the camera is not a joint one, or no board fits into the image.
    """
    errors = _px_errors(camera.plane_map, image_grid(camera.image_size, GRID_POINTS))
    if not errors.shape[2]:
        return None
    spread = errors[np.isfinite(errors).all(axis=(1, 2))].reshape(-1, errors.shape[2])
    variance = float((spread**2).sum())
    best, most = None, -1.0
    placements = list(_placements(camera, board, known, targets, np.random.default_rng(seed)))
    for pose, uv in _within_image(camera, board, placements):
        gain = _explained(camera, board, pose, uv, spread, camera.noise_px / weight)
        if gain is not None and gain > most:
            best, most = pose, gain
    if best is None:
        return None
    before, after = (float(np.sqrt(sum_of_squares / len(spread))) for sum_of_squares in (variance, variance - most))
    return NextBoard(best, camera.project(best.apply(_outline(board))), _tilt_deg(best, board), before, after)


def _tilt_deg(pose: Pose, board: Board) -> float:
    middle = pose.apply(lattice(board).mean(axis=0, keepdims=True))[0]
    return float(np.degrees(np.arccos(np.clip(pose.rotation[:, 2] @ middle / np.linalg.norm(middle), -1.0, 1.0))))


def _px_errors(plane_map: PlaneMap, uv: Floats) -> Floats:
    """A root (n, 2, r) of the covariance of the map at all ``uv`` (n, 2), as shifts of the pixels, in px."""
    return np.asarray(inverse_2x2(plane_map.jacobian(uv)) @ plane_map.covariance_root(uv))


def _outline(board: Board) -> Floats:
    (left, top), (right, bottom) = outline(board)
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def _placements(
    camera: VirtualCamera, board: Board, known: Mapping[str, Pose], targets: int, rng: np.random.Generator
) -> Iterable[Pose]:
    """Poses to try: a near and a typical distance for each target, with random tilts."""
    middle = np.append(lattice(board).mean(axis=0), 0.0)
    distances = [float(np.linalg.norm(pose.apply(middle[None])[0])) for pose in known.values()]
    extent = np.array(camera.image_size) - 1.0
    fractions = (np.arange(targets) + 0.5) / targets
    aims = grid_points(fractions, fractions) * extent
    for direction in camera.to_rays(aims).directions:
        for distance in np.quantile(distances, [0.1, 0.5]):
            tilt = Rotation.from_rotvec(np.append(rng.uniform(-MAX_TILT_RAD, MAX_TILT_RAD, 2), 0.0)).as_matrix()
            yield Pose(tilt, distance * direction - tilt @ middle)


def _within_image(camera: VirtualCamera, board: Board, poses: Sequence[Pose]) -> Iterator[tuple[Pose, Floats]]:
    """Those of ``poses`` at which the whole board is in the image, with the pixels (n, 2) of its corners."""
    points = lattice(board)
    uv = camera.project(np.concatenate([pose.apply(points) for pose in poses])).reshape(len(poses), *points.shape)
    for pose, seen in zip(poses, uv, strict=True):
        if ((seen > 0) & (seen < np.array(camera.image_size) - 1.0)).all():
            yield pose, seen


def _explained(
    camera: VirtualCamera, board: Board, pose: Pose, uv: Floats, spread: Floats, noise_px: float
) -> float | None:
    """The decrease of the sum of squares of ``spread`` by a board at ``pose`` with its corners at ``uv`` (n, 2).

    ``spread`` (m, r) is the effect of a root of the covariance; ``noise_px`` is that of the corners, per axis. None
    where the map has no ray at one of them.
    """
    plane_map = camera.plane_map
    every = max(1, len(uv) // SAMPLED_CORNERS)
    xyz, uv = pose.apply(lattice(board))[::every], uv[::every]
    by_point = inverse_2x2(plane_map.jacobian(uv)) @ camera.chart.coordinate_jacobian(xyz)
    own = np.concatenate([-by_point @ cross_matrices(xyz - pose.translation), by_point], axis=2).reshape(-1, POSE_DOF)
    rows = _px_errors(plane_map, uv).reshape(len(own), -1)
    if not (np.isfinite(own).all() and np.isfinite(rows).all()):
        return None
    rows -= own @ np.linalg.lstsq(own, rows, rcond=None)[0]  # the new board's own pose is free
    rows *= np.sqrt(every) / (noise_px * plane_map.disagreement)  # a board as noisy as the known ones
    # Woodbury: (1 + BᵀB)⁻¹ = 1 − Bᵀ(1 + BBᵀ)⁻¹B with B the rows.
    root = np.linalg.cholesky(np.eye(len(rows)) + rows @ rows.T)
    return float((np.linalg.solve(root, rows @ spread.T) ** 2).sum())
