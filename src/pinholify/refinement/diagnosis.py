"""Is it good? Structure in the residuals, boards that look wrong, and where the next board helps most.

Pure functions of residuals, such as a :class:`~pinholify.refinement.result.JointResult` has, and their corners.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import gammaincc, ndtr  # scipy.stats would take longer to import than to use

from pinholify.arrays import Bools, Floats, Ints, frozen
from pinholify.board import Board, lattice, outline
from pinholify.camera import VirtualCamera
from pinholify.corners import CornerSet
from pinholify.geometry import Pose
from pinholify.refinement.maps import JointMap
from pinholify.refinement.model import cross_matrices, rotations_of

NEIGHBOURS = 8
SHUFFLES = 199
SUSPICIOUS = 1e-4  # probability of so large a misfit, once corrected for the number of boards


class Residuals(Protocol):
    """Residuals (n, 2) px and inlier masks (n,) beside the corners of each view that was used, and their noise."""

    @property
    def residuals(self) -> Mapping[str, Floats]:
        """By view name, px."""
        ...

    @property
    def inliers(self) -> Mapping[str, Bools]:
        """By view name: which corners to look at."""
        ...

    @property
    def noise_px(self) -> float:
        """Standard deviation of a corner of weight one, px per axis."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """Whether residuals that lie close together in the image are alike.

    ``correlation`` is the mean product of a whitened residual with its neighbours' (0: none, 1: they are the same),
    ``p_value`` the probability of as much or more where there is no structure.
    """

    correlation: float
    p_value: float


def residual_structure(result: Residuals, corners: CornerSet, *, seed: int = 0) -> Structure:
    """Moran's I of the whitened inlier residuals over the nearest corners of *other* boards (Moran 1950).

    What a camera model lacks shows where several boards agree, and a board's own error (its pose, its bow) does not:
    hence other boards only. The null distribution turns each board's residuals as a whole by a random angle and
    sign, which keeps what is alike within a board.
    """
    uv, whitened, board = _inliers(result, corners)
    first, second = _pairs_across_boards(uv, board)
    if not len(first):
        return Structure(0.0, 1.0)
    power = float((whitened**2).sum(axis=1).mean())
    observed = float((whitened[first] * whitened[second]).sum(axis=1).mean()) / power
    rng = np.random.default_rng(seed)
    null = np.empty(SHUFFLES)
    for i in range(SHUFFLES):
        angle = rng.uniform(0.0, 2.0 * np.pi, board.max() + 1)[board]
        cosine, sine = np.cos(angle), np.sin(angle)
        turned = np.column_stack(
            [cosine * whitened[:, 0] - sine * whitened[:, 1], sine * whitened[:, 0] + cosine * whitened[:, 1]]
        )
        null[i] = (turned[first] * turned[second]).sum(axis=1).mean() / power
    return Structure(observed, float(ndtr(-observed / null.std())))


def _inliers(result: Residuals, corners: CornerSet) -> tuple[Floats, Floats, Ints]:
    """Places (n, 2) px, residuals in standard deviations (n, 2), and the board's index (n,)."""
    used = [view for view in corners.views if view.name in result.residuals]
    uv, whitened, board = [], [], []
    for k, view in enumerate(used):
        keep = result.inliers[view.name]
        uv.append(view.uv[keep])
        whitened.append(result.residuals[view.name][keep] * view.weights[keep, None] / result.noise_px)
        board.append(np.full(int(keep.sum()), k))
    return np.concatenate(uv), np.concatenate(whitened), np.concatenate(board)


def _pairs_across_boards(uv: Floats, board: Ints) -> tuple[Ints, Ints]:
    near = cKDTree(uv).query(uv, k=min(NEIGHBOURS + 1, len(uv)))[1][:, 1:]
    first = np.repeat(np.arange(len(uv)), near.shape[1])
    second = near.ravel()
    across = board[first] != board[second]
    return first[across], second[across]


@dataclass(frozen=True, slots=True)
class BoardSuspicion:
    """``ratio`` of a board's RMS residual to the noise, and the probability ``p_value`` of a larger one by chance."""

    name: str
    ratio: float
    p_value: float


def suspicious_boards(result: Residuals, corners: CornerSet) -> list[BoardSuspicion]:
    """Used boards whose residuals are too large for the noise, worst first.

    By the χ² of their inliers with six degrees of freedom taken by the pose, corrected for the number of boards
    (Bonferroni). Boards that were not used at all are in ``result.dropped`` with the reason.
    """
    found = []
    for view in corners.views:
        if view.name not in result.residuals:
            continue
        keep = result.inliers[view.name]
        whitened = result.residuals[view.name][keep] * view.weights[keep, None] / result.noise_px
        freedom = max(whitened.size - 6, 1)
        misfit = float((whitened**2).sum())
        p_value = min(1.0, float(gammaincc(freedom / 2.0, misfit / 2.0)) * len(result.residuals))
        if p_value < SUSPICIOUS:
            found.append(BoardSuspicion(view.name, float(np.sqrt(misfit / freedom)), p_value))
    return sorted(found, key=lambda suspicion: -suspicion.ratio)


@dataclass(frozen=True, slots=True, eq=False)
class NextBoard:
    """A place for the next board: its ``pose``, its ``outline`` (n, 2) px in the image, and what it would bring.

    ``std_before`` and ``std_after`` are the root mean square of the predicted standard deviation over the image, px.
    """

    pose: Pose
    outline: Floats
    std_before: float
    std_after: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "outline", frozen(self.outline, (None, 2)))


def next_board(
    camera: VirtualCamera, board: Board, known: Mapping[str, Pose], *, targets: int = 5, seed: int = 0
) -> NextBoard | None:
    """Where one more photograph would lower the predicted variance over the whole image most.

    Tries boards at the distances of the ``known`` ones, aimed at ``targets`` × ``targets`` pixels, with the tilts that
    people manage, and for each works out the posterior that its corners would leave (Bayesian experimental design;
    no measurement is needed for that). None where the camera is no joint one, or no board fits into the image.
    """
    plane_map = camera.plane_map
    if not isinstance(plane_map, JointMap):
        return None
    grid = _image_grid(camera.image_size, 12)
    features = _px_features(plane_map, grid)
    before = float(np.sqrt(((features @ plane_map.root) ** 2).sum(axis=(1, 2)).mean() / 2.0))
    best: NextBoard | None = None
    for pose in _placements(camera, board, known, targets, np.random.default_rng(seed)):
        root = _root_after(camera, plane_map, board, pose)
        if root is None:
            continue
        after = float(np.sqrt(((features @ root) ** 2).sum(axis=(1, 2)).mean() / 2.0))
        if best is None or after < best.std_after:
            best = NextBoard(pose, camera.project(pose.apply(_outline(board))), before, after)
    return best


def _image_grid(image_size: tuple[int, int], count: int) -> Floats:
    u, v = (np.linspace(0.0, extent - 1.0, count) for extent in image_size)
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def _px_features(plane_map: JointMap, uv: Floats) -> Floats:
    """∂(shift of the pixel)/∂unknowns, (n, 2, D)."""
    return np.asarray(np.linalg.solve(plane_map.jacobian(uv), plane_map.features(uv)))


def _outline(board: Board) -> Floats:
    (left, top), (right, bottom) = outline(board)
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def _placements(
    camera: VirtualCamera, board: Board, known: Mapping[str, Pose], targets: int, rng: np.random.Generator
) -> Iterable[Pose]:
    middle = np.append(lattice(board).mean(axis=0), 0.0)
    distances = [float(np.linalg.norm(pose.apply(middle[None])[0])) for pose in known.values()]
    extent = np.array(camera.image_size) - 1.0
    fractions = (np.arange(targets) + 0.5) / targets
    aims = np.stack(np.meshgrid(fractions, fractions), axis=-1).reshape(-1, 2) * extent
    for direction in camera.to_rays(aims).directions:
        for distance in np.quantile(distances, [0.1, 0.5]):
            tilt = rotations_of(np.append(rng.uniform(-0.6, 0.6, 2), 0.0)[None])[0]
            yield Pose(tilt, distance * direction - tilt @ middle)


def _root_after(camera: VirtualCamera, plane_map: JointMap, board: Board, pose: Pose) -> Floats | None:
    """The root of the covariance once a board at ``pose`` were seen too; None where the image does not hold it."""
    xyz = pose.apply(lattice(board))
    uv = camera.project(xyz)
    inside = np.isfinite(uv).all() and (uv > 0).all() and (uv < np.array(camera.image_size) - 1.0).all()
    if not inside:
        return None
    rays = _px_features(plane_map, uv) @ plane_map.root
    by_point = np.linalg.solve(plane_map.jacobian(uv), camera.chart.coordinate_jacobian(xyz))
    turned = pose.apply(lattice(board)) - pose.translation
    own = np.concatenate([-by_point @ cross_matrices(turned), by_point], axis=2).reshape(-1, 6)
    rows = rays.reshape(len(own), -1)
    rows = rows - own @ np.linalg.lstsq(own, rows, rcond=None)[0]  # the new board's own pose is free
    information = np.eye(rows.shape[1]) + rows.T @ rows / camera.noise_px**2
    return np.asarray(np.linalg.solve(np.linalg.cholesky(information), plane_map.root.T).T)
