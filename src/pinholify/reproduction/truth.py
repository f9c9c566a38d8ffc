"""What was found against what was rendered: corners, the map, K and the boards' poses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pinholify.arrays import Floats
from pinholify.board import Board
from pinholify.calibration.poses import moved
from pinholify.camera import VirtualCamera
from pinholify.charts import Intrinsics
from pinholify.corners import Corners, CornerSet
from pinholify.evaluation.baseline import BoardPoints
from pinholify.evaluation.heldout import alternating_split, heldout_rms
from pinholify.evaluation.measures import rms, root_mean_square
from pinholify.evaluation.summary import Evaluation
from pinholify.geometry import Pose, apply_homography, estimate_homography
from pinholify.simulation.datasets import CameraTruth, Dataset
from pinholify.simulation.lenses import Lens
from pinholify.simulation.views import virtual_camera


@dataclass(frozen=True, slots=True, eq=False)
class CornerErrors:
    """Detected corners against true ones: RMS distance in px, and their mean shift along u and v in px."""

    rms_px: float
    shift_px: tuple[float, float]


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """RMS over boards: the turn in degrees and the distance of the board's middle in squares.

    Poses are taken relative to the reference board, which needs no optical centre.
    """

    turn_degrees: float
    middle_squares: float


@dataclass(frozen=True, slots=True, eq=False)
class TruthErrors:
    """A calibration against truth.

    ``map_px``: RMS error of the map in px of the image inside the reference board, best homography removed.
    ``intrinsics`` are the true (f, uc, vc) in squares and ``intrinsics_error`` found minus true; None for a system
    without a single centre. Poses in closed form and refined.
    """

    map_px: float
    intrinsics: tuple[float, float, float] | None
    intrinsics_error: tuple[float, float, float] | None
    closed_form: PoseErrors
    refined: PoseErrors


def numbered_poses(dataset: Dataset, corner_set: CornerSet) -> dict[str, Pose]:
    """The true poses by image, turned by 180° in the board's plane where the corners are numbered from its other end.

    (A board of an even sum of columns and rows looks the same either way, and either numbering is right.)
    """
    poses = dataset.poses()[: len(corner_set.views)]
    return {
        view.name: _as_numbered(dataset.lens, dataset.board, pose, view)
        for view, pose in zip(corner_set.views, poses, strict=True)
        if view.found
    }


def _as_numbered(lens: Lens, board: Board, pose: Pose, view: Corners) -> Pose:
    end = np.array([board.columns - 1.0, board.rows - 1.0, 0.0])
    turned = Pose(pose.rotation * [-1.0, -1.0, 1.0], pose.rotation @ end + pose.translation)
    return min((pose, turned), key=lambda p: rms(_shifts(lens, board, p, view)))


def _shifts(lens: Lens, board: Board, pose: Pose, view: Corners) -> Floats:
    """Detected minus true corners (n, 2), px."""
    true = lens.project(pose.apply(view.lattice(board)))
    return np.asarray(view.uv - true)


def corner_errors(dataset: Dataset, corner_set: CornerSet, poses: Mapping[str, Pose]) -> CornerErrors:
    """All corners of ``corner_set`` against those that were rendered."""
    shifts = [_shifts(dataset.lens, dataset.board, poses[v.name], v) for v in corner_set.found]
    together = np.concatenate(shifts)
    u, v = together.mean(axis=0)
    return CornerErrors(rms(together), (float(u), float(v)))


def exact_corners(dataset: Dataset, corner_set: CornerSet, poses: Mapping[str, Pose]) -> CornerSet:
    """The corners of ``corner_set`` where they were rendered instead of where they were found."""
    views = (
        Corners(v.name, v.ids, dataset.lens.project(poses[v.name].apply(v.lattice(dataset.board))))
        for v in corner_set.found
    )
    return corner_set.with_views(views)


def truth_errors(dataset: Dataset, evaluation: Evaluation, poses: Mapping[str, Pose]) -> TruthErrors:
    """The calibration that ``evaluation`` scored, against ``dataset``; ``poses`` as :func:`numbered_poses` gives."""
    calibration = evaluation.calibration
    reference = poses[calibration.reference]
    k, true_k = calibration.camera.intrinsics, virtual_camera(reference) if dataset.lens.central else None
    error = None if true_k is None else (k.f - true_k[0], k.uc - true_k[1], k.vc - true_k[2])
    middle = np.array([[dataset.board.columns - 1.0, dataset.board.rows - 1.0]]) / 2.0
    others = [(o, poses[name]) for name, o in evaluation.observed.items() if name != calibration.reference]
    found_closed = [relative(_of_reference(calibration.closed_form or k), o.closed_form) for o, _ in others]
    found_refined = [relative(_of_reference(k), o.refined) for o, _ in others]
    true = [relative(reference, pose) for _, pose in others]
    return TruthErrors(
        map_error(calibration.camera, dataset.lens, dataset.truth(), reference),
        true_k,
        error,
        _pose_errors(found_closed, true, middle),
        _pose_errors(found_refined, true, middle),
    )


def _of_reference(k: Intrinsics) -> Pose:
    """Where the reference board stands in the camera's frame, by definition."""
    return Pose(np.eye(3), np.array([-k.uc, -k.vc, k.f]))


def relative(reference: Pose, pose: Pose) -> Pose:
    """``pose`` in the frame of the board at ``reference``."""
    back = reference.rotation.T
    return Pose(back @ pose.rotation, back @ (pose.translation - reference.translation))


def _pose_errors(found: Sequence[Pose], true: Sequence[Pose], middle: Floats) -> PoseErrors:
    turns = [Rotation.from_matrix(a.rotation @ b.rotation.T).magnitude() for a, b in zip(found, true, strict=True)]
    shifts = [float(np.linalg.norm(a.apply(middle) - b.apply(middle))) for a, b in zip(found, true, strict=True)]
    return PoseErrors(float(np.rad2deg(root_mean_square(turns))), root_mean_square(shifts))


def map_error(camera: VirtualCamera, lens: Lens, truth: CameraTruth, reference: Pose) -> float:
    """RMS error of the map in px over the truth's pixels inside the camera's hull, best homography removed.

    Judged on the plane of the board at ``reference``, where a system without a centre has a true map too: the points
    that pixels should see there against those that the camera says, imaged by the true lens.
    """
    inside = camera.domain.hull.contains(truth.pixels) & np.isfinite(truth.directions).all(axis=1)
    pixels, origins, directions = truth.pixels[inside], truth.origins[inside], truth.directions[inside]
    normal, axes = reference.rotation[:, 2], reference.rotation[:, :2]
    start = origins - reference.translation
    distance = -(start @ normal) / (directions @ normal)
    on_board = start @ axes + distance[:, None] * (directions @ axes)
    mapped = camera.virtual_points(pixels)
    fitted = apply_homography(estimate_homography(mapped, on_board), mapped)
    return rms(lens.project(reference.apply(fitted)) - pixels)



def heldout_floor(
    lens: Lens, corner_set: CornerSet, views: Sequence[Corners], poses: Iterable[Pose]
) -> float | None:
    """The held-out error in px that the true ``lens`` has on ``views``, poses refitted: what corner noise leaves.

    The same split and corners as for every other model; the search starts from the true ``poses``. None where nothing
    is held out.
    """
    known = list(poses)

    def residuals(board: BoardPoints) -> Floats:
        def misses(pose: Pose) -> Floats:
            return np.asarray(lens.project(pose.apply(board.lattice)) - board.uv)

        start = min(known, key=lambda pose: rms(misses(pose)))
        fit = least_squares(lambda step: misses(moved(start, step)).ravel(), np.zeros(6), x_scale="jac")
        return np.asarray(fit.fun.reshape(-1, 2))

    return heldout_rms(residuals, alternating_split(corner_set, views).test)
