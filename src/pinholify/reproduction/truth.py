"""Errors against the rendered truth: of corners, the map, K and the boards' poses."""

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
from pinholify.evaluation.heldout import alternating_split, heldout_rms
from pinholify.evaluation.measures import rms, root_mean_square
from pinholify.evaluation.summary import Evaluation
from pinholify.geometry import Pose, apply_homography, estimate_homography
from pinholify.simulation.datasets import CameraTruth, Dataset
from pinholify.simulation.lenses import Lens
from pinholify.simulation.views import virtual_camera


@dataclass(frozen=True, slots=True, eq=False)
class CornerErrors:
    """Errors of detected corners: RMS distance, and mean shift along u and v, in px."""

    rms_px: float
    shift_px: tuple[float, float]


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """RMS errors over boards: of the rotation in degrees, and of the board's centre in squares.

    Poses are relative to the reference board, which requires no optical centre.
    """

    turn_degrees: float
    middle_squares: float


@dataclass(frozen=True, slots=True, eq=False)
class TruthErrors:
    """Errors of a calibration.

    ``map_px`` is the RMS error of the map inside the reference board after removing the best homography, in px of the
    image. ``intrinsics`` are the true (f, uc, vc) in squares and ``intrinsics_error`` found minus true; None for a
    system without a single centre. ``closed_form`` and ``refined`` are the errors of the poses.
    """

    map_px: float
    intrinsics: tuple[float, float, float] | None
    intrinsics_error: tuple[float, float, float] | None
    closed_form: PoseErrors
    refined: PoseErrors


def numbered_poses(dataset: Dataset, corner_set: CornerSet) -> dict[str, Pose]:
    """The true poses by image, rotated by 180° in the board's plane if the corners are numbered from its other end.

    A board with an even sum of columns and rows has this symmetry, and either numbering is correct.
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
    """The errors of all corners of ``corner_set``; ``poses`` as from :func:`numbered_poses`."""
    shifts = [_shifts(dataset.lens, dataset.board, poses[v.name], v) for v in corner_set.found]
    together = np.concatenate(shifts)
    u, v = together.mean(axis=0)
    return CornerErrors(rms(together), (float(u), float(v)))


def exact_corners(dataset: Dataset, corner_set: CornerSet, poses: Mapping[str, Pose]) -> CornerSet:
    """``corner_set`` with the rendered instead of the detected corners."""
    views = (
        Corners(v.name, v.ids, dataset.lens.project(poses[v.name].apply(v.lattice(dataset.board))))
        for v in corner_set.found
    )
    return corner_set.with_views(views)


def truth_errors(dataset: Dataset, evaluation: Evaluation, poses: Mapping[str, Pose]) -> TruthErrors:
    """Errors of the evaluated calibration of ``dataset``; ``poses`` as from :func:`numbered_poses`."""
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
    """The pose of the reference board in the camera's frame, by definition."""
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
    """RMS error of the map in px over the truth's pixels inside the camera's hull, after removing the best homography.

    It is measured on the plane of the board at ``reference``, where a system without a centre has a true map as well:
    the points there that pixels see according to the camera, imaged by the true lens, minus those pixels.
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
    """The held-out error in px of the true ``lens`` on ``views``, with poses refitted: what corner noise leaves.

    The split and the corners are those of every other model; the fits start from the true ``poses``. None if nothing is
    held out.
    """
    known = list(poses)

    def residuals(view: Corners) -> Floats:
        def misses(pose: Pose) -> Floats:
            return np.asarray(lens.project(pose.apply(view.lattice(corner_set.board))) - view.uv)

        start = min(known, key=lambda pose: rms(misses(pose)))
        fit = least_squares(lambda step: misses(moved(start, step)).ravel(), np.zeros(6), x_scale="jac")
        return np.asarray(fit.fun.reshape(-1, 2))

    return heldout_rms(residuals, alternating_split(corner_set, views).test)
