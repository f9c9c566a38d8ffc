"""The result of the joint refinement, in the reference board's frame, in px and in squares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from pinholify.arrays import Bools, Floats
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import AngleChart, Intrinsics
from pinholify.corners import Corners
from pinholify.geometry import POSE_DOF, Pose, convex_hull
from pinholify.refinement.maps import JointMap
from pinholify.refinement.observations import ImageFrame, Observations
from pinholify.refinement.outliers import OUTLIER_LIMIT
from pinholify.refinement.settle import Settled
from pinholify.refinement.shape import BEND, STRETCH, WARP
from pinholify.refinement.solver import lengths

TURN_CORNERS = 1000  # at least, over which the rotations of ``turn_root`` are fitted
DOMAIN_STD = 5.0  # a map's std, in those of a corner times the disagreement, beyond which it is not valid


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """How the board differs from a flat lattice of squares.

    ``bow`` is the largest height difference over the board, in squares. ``stretch`` is how much longer a square is
    along y than along x, as a fraction, and ``shear`` how far columns lean towards x per square along y. ``warp`` is
    the RMS of other shifts of the corners in the board's plane, in squares. Each is None where the data prefer a board
    without it. ``points`` (corners of the board, 3) are its points by id, in squares from its middle, with z positive
    away from the camera.
    """

    bow: float | None
    stretch: float | None
    shear: float | None
    warp: float | None
    points: Floats


@dataclass(frozen=True, slots=True, eq=False)
class JointResult:
    """A camera found from all boards together.

    ``intrinsics_covariance`` (3, 3) is that of (f, uc, vc) in squares². ``poses`` are ``camera_from_board`` by view
    name, in squares; the board of the view ``reference`` fixes the camera's frame. ``residuals`` (n, 2) px and
    ``inliers`` (n,) belong to the corners of each used view; a residual is nan where the camera has no ray.
    ``dropped`` are the views that were not used, with the reason, and ``dropped_corners`` the numbers of corners
    dropped from used views. ``candidates`` are the trends compared (``+gp`` with the process) with their log evidence
    as a density per squared px. ``noise_px`` is the standard deviation of a corner of weight one per axis;
    ``kernel_px`` is (σ_f, length scales) in px, empty where the evidence switched the process off.

    ``board_noise_px`` is each used view's own noise, equal to ``noise_px`` unless views differ by more than chance.
    ``start_fits`` tells whether the camera given as a start explains the corners, None where none was given.
    ``disagreement`` is the ratio of the boards' disagreement to what noise explains; every standard deviation includes
    it. ``motion_px`` is the RMS per axis of the boards' motions while the shutter rolled, beyond what poses absorb.
    ``too_few`` is True where boards differ by more than noise and are too few to show why: motions, or a print that is
    not a square lattice.
    """

    camera: VirtualCamera
    intrinsics_covariance: Floats
    poses: Mapping[str, Pose]
    residuals: Mapping[str, Floats]
    inliers: Mapping[str, Bools]
    dropped: Mapping[str, str]
    noise_px: float
    reference: str
    kernel: str
    trend: str
    candidates: tuple[tuple[str, float], ...]
    kernel_px: tuple[float, ...]
    shape: Shape
    log_evidence: float
    board_noise_px: Mapping[str, float]
    start_fits: bool | None = None
    disagreement: float = 1.0
    motion_px: float = 0.0
    too_few: bool = False

    def inliers_of(self, view: Corners, solved: Corners, points: Floats) -> Bools:
        """Mask (n,) of the corners of ``view`` that agree with the camera.

        ``solved`` represented the view in the solve. Corners that were condensed into others are judged by the same
        limit; ``points`` (corners, 3) are the board's by id, in squares.
        """
        if solved is view:
            return self.inliers[view.name]
        projected = self.camera.project(self.poses[view.name].apply(points[view.ids]))
        return lengths(projected - view.uv, view.weights) <= OUTLIER_LIMIT * self.board_noise_px[view.name]

    @property
    def intrinsics_std(self) -> Floats:
        """Standard deviations (3,) of (f, uc, vc), in squares."""
        return np.sqrt(np.diag(self.intrinsics_covariance))

    @property
    def dropped_corners(self) -> dict[str, int]:
        """The number of wrong corners of each used view that has any."""
        return {name: int((~mask).sum()) for name, mask in self.inliers.items() if not mask.all()}


def joint_map(settled: Settled, seen: Observations, frame: ImageFrame, reference: int, middle: Floats) -> JointMap:
    """The map of the finished solve, with its covariance, and the board with index ``reference`` as its frame."""
    state, root = settled.solution.state, covariance_root(settled, reference)
    joint = JointMap(
        frame,
        settled.model.trend,
        state.beta,
        settled.model.basis,
        state.weights,
        state.rotations[reference],
        state.translations[reference],
        middle,
        root,
        np.zeros((3, root.shape[1])),
    )
    every = max(1, len(seen.image) // TURN_CORNERS)
    return joint.with_turn_fitted(frame.restore(seen.image[::every]))


def covariance_root(settled: Settled, board: int) -> Floats:
    """A root (D' + 6, r) of the posterior covariance of weights, β and the pose of ``board``; η is marginalised."""
    noise, precision, equations = settled.hyperparameters.noise, settled.precision, settled.equations
    scale = precision**-0.5
    whitened = equations.matrix * (scale[:, None] * scale / noise**2)
    whitened[np.diag_indices(len(scale))] += 1.0
    globals_root = (
        scale[:, None]
        * solve_triangular(np.linalg.cholesky(whitened), np.eye(len(scale)), lower=True, check_finite=False).T
    )
    back = equations.inverse_roots[board].T[:POSE_DOF]
    pose = np.concatenate([-back @ (equations.cross[board] @ globals_root), noise * back], axis=1)
    kept = len(scale) - len(settled.model.shape.prior_std)
    widened = np.concatenate([globals_root[:kept], np.zeros((kept, back.shape[1]))], axis=1)
    return np.concatenate([widened, pose])


def intrinsics_of(plane_map: JointMap) -> Intrinsics:
    """K of the camera whose virtual plane is that of the reference board; f is the distance of that plane."""
    x, y, f = plane_map.rotation.T @ plane_map.translation
    return Intrinsics(float(f), float(plane_map.middle[0] - x), float(plane_map.middle[1] - y))


def camera_of(
    plane_map: JointMap, seen: Observations, image_size: tuple[int, int], noise_px: float, error_px: float
) -> VirtualCamera:
    """The virtual camera in the reference board's frame, whose domain is the hull of all corners.

    ``error_px`` is the standard deviation of a corner of typical weight in the photographs: noise, and shifts by warp
    and motions.
    """
    frame = plane_map.frame
    limit = DOMAIN_STD * error_px * plane_map.disagreement
    domain = Domain(convex_hull(frame.restore(seen.image)), limit)
    chart = AngleChart(plane_map.rotation.T, intrinsics_of(plane_map))
    return VirtualCamera(plane_map, chart, domain, image_size, noise_px, frame.mirrored)


def intrinsics_covariance(plane_map: JointMap) -> Floats:
    """Covariance (3, 3) of (f, uc, vc), squares²."""
    half = plane_map.intrinsics_features() @ plane_map.root
    return np.asarray(half @ half.T)


def poses_of(settled: Settled, seen: Observations, plane_map: JointMap) -> dict[str, Pose]:
    """Poses, camera_from_board by view name, of all boards' lattices in the reference board's frame, in squares."""
    state = settled.solution.state
    middle = np.append(plane_map.middle, 0.0)
    turn = plane_map.rotation.T
    return {
        name: Pose(turn @ rotation, turn @ (translation - rotation @ middle))
        for name, rotation, translation in zip(seen.names, state.rotations, state.translations, strict=True)
    }


def shape_of(settled: Settled) -> Shape:
    """The shape of the board in the finished solve."""
    shape, eta = settled.model.shape, settled.solution.state.eta
    points, stretches, warps = shape.points(eta), shape.has(STRETCH), shape.has(WARP)
    return Shape(
        float(np.ptp(points[:, 2])) if shape.has(BEND) or warps else None,
        shape.stretch(eta) if stretches else None,
        shape.shear(eta) if stretches else None,
        float(np.sqrt((shape.warp(eta)[:, :2] ** 2).sum(axis=1).mean())) if warps else None,
        points,
    )
