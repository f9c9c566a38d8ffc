"""A second look at a board, once the camera is known.

The camera and the board's pose predict every corner, the direction and curvature of its lines, and the uncertainty. All
corners are fitted again in windows that follow these lines; corners that the first detection missed are accepted if
they have the right colours and lie inside their gates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Floats
from pinholify.board import Board, Charuco, Checkerboard, lattice, size
from pinholify.calibration.observation import MINIMUM_CORNERS, estimate_pose, sighting_of
from pinholify.calibration.poses import pose_residuals
from pinholify.calibration.result import flat
from pinholify.camera import VirtualCamera
from pinholify.corners import Corners
from pinholify.detection.growth import signs
from pinholify.detection.intensity import Grey, grey_levels
from pinholify.detection.lattice import Lattice
from pinholify.detection.prediction import Prediction
from pinholify.detection.refine import fit_corners, settled, true_corners, weights
from pinholify.errors import CalibrationError
from pinholify.geometry import Pose

STEP = 0.25
"""Squares to each side of a corner at which the board's lines are projected."""

AROUND = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])

MAX_MISFIT = 0.1
"""As a fraction of the spacing: where the known corners fit the camera worse, another camera took the photograph."""

MAX_RELATIVE_STD = 0.25
"""Standard deviation, as a fraction of the spacing, above which a corner is not searched for."""

GATE_STDS = 6.0
"""Standard deviations from its expected position within which a corner is accepted."""

MODEL_ERROR_PX = 0.05
"""Error of a camera that its own standard deviation does not include, e.g. outside the region of its corners."""


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """Expected corners of a board: ``prediction`` of all n, and ``second`` derivatives (n, 2, 3) in px.

    ``certain`` (n,): those in the image whose position is known well enough.
    """

    prediction: Prediction
    second: Floats
    certain: Bools


def look_again(image: NDArray[Any], view: Corners, board: Board, camera: VirtualCamera) -> Corners:
    """``view`` with its corners fitted again, and with further corners of ``board`` that ``camera`` predicts.

    ``image`` is as in :func:`pinholify.detection.detect_board`. A view with too few corners for a pose, or that the
    camera does not fit, is returned unchanged, and so are views of boards other than checkerboards and ChArUco boards.
    """
    if not isinstance(board, Checkerboard | Charuco) or len(view) < MINIMUM_CORNERS:
        return view
    expected = expect(camera, view, board)
    if expected is None:
        return view
    return _fitted(grey_levels(image), view, board, expected)


def expect(camera: VirtualCamera, view: Corners, board: Board) -> Expected | None:
    """The corners of ``board`` that ``camera`` predicts from those of ``view``; None where it does not fit them."""
    points = view.lattice(board)
    known = camera.inside(view.uv)
    if known.sum() < MINIMUM_CORNERS:
        return None
    try:
        pose, covariance = estimate_pose(camera, sighting_of(camera, flat(points[known]), view.uv[known]))
    except (CalibrationError, np.linalg.LinAlgError):  # no pose fits the corners of another camera
        return None
    places = lattice(board)
    around = places[:, None] + STEP * AROUND
    uv = camera.project(pose.apply(flat(around.reshape(-1, 2)))).reshape(len(places), len(AROUND), 2)
    jacobian, second = _derivatives(uv)
    spacing = np.linalg.norm(jacobian, axis=1).min(axis=1)
    miss = (uv[view.ids, 0] - view.uv)[known]
    noise = camera.noise_px / np.median(view.weights[known])
    scatter = float(np.fmax(noise, 1.4826 * np.median(np.abs(miss))))  # an imported camera has no noise_px
    if not scatter < MAX_MISFIT * float(np.median(spacing[view.ids[known]])):
        return None
    inside = ((uv > 0) & (uv < np.array(camera.image_size) - 1)).all(axis=(1, 2))
    std = np.full(len(places), np.inf)
    std[inside] = _std(camera, pose, covariance * scatter**2, places[inside], uv[inside, 0], scatter)
    return Expected(Prediction(uv[:, 0], std, jacobian, spacing), second, inside & (std < MAX_RELATIVE_STD * spacing))


def _derivatives(uv: Floats) -> tuple[Floats, Floats]:
    """First (n, 2, 2) and second (n, 2, 3) derivatives, from the pixels ``uv`` (n, 9, 2) of the points AROUND."""
    _, right, left, down, up, both, neither, upper, lower = uv.transpose(1, 0, 2)
    jacobian = np.stack([right - left, down - up], axis=2) / (2 * STEP)
    middle = uv[:, 0]
    mixed = (both + neither - upper - lower) / 4
    second = np.stack([right - 2 * middle + left, mixed, down - 2 * middle + up], axis=2) / STEP**2
    return jacobian, second


def _std(
    camera: VirtualCamera, pose: Pose, covariance: Floats, places: Floats, uv: Floats, scatter: float
) -> Floats:
    """Standard deviation (n,) in px of the distance between a found corner and its expected position.

    It includes the ``covariance`` of the ``pose``, the camera's map, the ``scatter`` of corners, and MODEL_ERROR_PX.
    """
    _, by_pose = pose_residuals(sighting_of(camera, flat(places), uv), pose, camera.chart)
    by_pose = by_pose.reshape(-1, 2, 6)
    variance = np.einsum("nij,jk,nik->n", by_pose, covariance, by_pose) / 2
    return np.asarray(np.sqrt(variance + camera.shape_std(uv) ** 2 + scatter**2 + MODEL_ERROR_PX**2))


def _fitted(grey: Grey, view: Corners, board: Board, expected: Expected) -> Corners:
    """The corners of ``view``, and others found in ``grey`` where they are ``expected``, fitted along expected lines.

    Corners of ``view`` keep their position if their new fit fails.
    """
    known = np.isin(np.arange(size(board)), view.ids)
    ids = np.flatnonzero(known | expected.certain)
    known, prediction = known[ids], expected.prediction
    uv, jacobian = prediction.uv[ids], prediction.jacobian[ids]
    weight, old = np.zeros(len(ids)), np.searchsorted(ids, view.ids)
    uv[old], weight[old] = view.uv, view.weights
    uv[~known] = settled(grey, uv[~known], jacobian[~known])
    crossings = fit_corners(grey, uv, jacobian, expected.second[ids])
    row, column = np.divmod(ids, board.columns)
    index = np.stack([column, row], axis=1)
    phase = 1 if np.median((crossings.strength * signs(index, 1))[known]) > 0 else -1
    lattice = Lattice(index, crossings.uv, weights(crossings), phase)
    miss = np.linalg.norm(crossings.uv - prediction.uv[ids], axis=1)
    near = miss < GATE_STDS * np.hypot(prediction.std[ids], crossings.std)
    good = near & true_corners(lattice, crossings, known)
    uv, weight = np.where(good[:, None], crossings.uv, uv), np.where(good, lattice.weights, weight)
    kept = known | good
    return replace(view, ids=ids[kept], uv=uv[kept], weights=weight[kept])
