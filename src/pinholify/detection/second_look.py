"""A second look at a board, once the camera is known.

The camera and the board's pose tell where every corner is, how its lines run there, and how far off that may be. All
corners are fitted anew in windows that are equal squares of the board, their edges as straight as in the virtual plane;
those that the first look missed are accepted with the right colours inside their gates.
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
from pinholify.geometry import Pose

STEP = 0.25
"""Squares to each side of a corner at which the board's lines are followed."""

AROUND = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])

MOST_MISFIT = 0.1
"""Of the spacing: where the corners known fit the camera worse, it is another camera's photograph."""

MOST_RELATIVE_STD = 0.25
"""Standard deviation, as a fraction of the spacing, above which a place is not known well enough to look there."""

GATE_STDS = 6.0
"""Standard deviations from its expected place within which a corner may be found."""

MODEL_ERROR_PX = 0.05
"""px. How far off a camera may be where its own standard deviation says nothing of it, as beyond its corners."""


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """Where a camera expects the corners of a board: ``prediction`` of all, and ``second`` (n, 2, 3) derivatives in px.

    ``sure`` (n,) are those in the image whose place is known well enough.
    """

    prediction: Prediction
    second: Floats
    sure: Bools


def look_again(image: NDArray[Any], view: Corners, board: Board, camera: VirtualCamera) -> Corners:
    """``view`` with its corners fitted anew, and with those that ``camera`` expects and ``image`` shows besides.

    ``image`` is as of :func:`pinholify.detection.detect_board`. A view with too few corners for a pose, or that the
    camera does not fit, stays as it is, and so do views of boards other than checkerboards and ChArUco boards.
    """
    if not isinstance(board, Checkerboard | Charuco) or len(view) < MINIMUM_CORNERS:
        return view
    expected = expect(camera, view, board)
    if expected is None:
        return view
    return _fitted(grey_levels(image), view, board, expected)


def expect(camera: VirtualCamera, view: Corners, board: Board) -> Expected | None:
    """Where ``camera`` expects all corners of ``board`` from those of ``view``; None where it does not fit them."""
    points = view.lattice(board)
    known = camera.inside(view.uv)
    if known.sum() < MINIMUM_CORNERS:
        return None
    try:
        pose, covariance = estimate_pose(camera, sighting_of(camera, flat(points[known]), view.uv[known]))
    except np.linalg.LinAlgError:  # no pose comes near corners of another camera
        return None
    places = lattice(board)
    around = places[:, None] + STEP * AROUND
    uv = camera.project(pose.apply(flat(around.reshape(-1, 2)))).reshape(len(places), len(AROUND), 2)
    jacobian, second = _derivatives(uv)
    spacing = np.linalg.norm(jacobian, axis=1).min(axis=1)
    miss = (uv[view.ids, 0] - view.uv)[known]
    scatter = float(np.fmax(camera.noise_px, 1.4826 * np.median(np.abs(miss))))  # an imported camera knows no noise
    if not scatter < MOST_MISFIT * float(np.median(spacing[view.ids[known]])):
        return None
    inside = ((uv > 0) & (uv < np.array(camera.image_size) - 1)).all(axis=(1, 2))
    std = np.full(len(places), np.inf)
    std[inside] = _std(camera, pose, covariance * scatter**2, places[inside], uv[inside, 0], scatter)
    return Expected(Prediction(uv[:, 0], std, jacobian, spacing), second, inside & (std < MOST_RELATIVE_STD * spacing))


def _derivatives(uv: Floats) -> tuple[Floats, Floats]:
    """First (n, 2, 2) and second (n, 2, 3) derivatives of ``uv`` (n, 9, 2), known at the places AROUND."""
    _, right, left, down, up, both, neither, upper, lower = uv.transpose(1, 0, 2)
    jacobian = np.stack([right - left, down - up], axis=2) / (2 * STEP)
    middle = uv[:, 0]
    mixed = (both + neither - upper - lower) / 4
    second = np.stack([right - 2 * middle + left, mixed, down - 2 * middle + up], axis=2) / STEP**2
    return jacobian, second


def _std(
    camera: VirtualCamera, pose: Pose, covariance: Floats, places: Floats, uv: Floats, scatter: float
) -> Floats:
    """Standard deviation (n,) px of a corner found from where it is expected.

    It is made of the ``pose`` with its ``covariance``, the camera's map, the ``scatter`` of corners, and MODEL_ERROR_PX.
    """
    _, by_pose = pose_residuals(sighting_of(camera, flat(places), uv), pose, camera.chart)
    by_pose = by_pose.reshape(-1, 2, 6)
    variance = np.einsum("nij,jk,nik->n", by_pose, covariance, by_pose) / 2
    return np.asarray(np.sqrt(variance + camera.shape_std(uv) ** 2 + scatter**2 + MODEL_ERROR_PX**2))


def _fitted(grey: Grey, view: Corners, board: Board, expected: Expected) -> Corners:
    """The corners of ``view``, and those that ``grey`` shows where they are ``expected``, fitted along lines that are.

    Corners of ``view`` stay where they are if their new fit fails.
    """
    known = np.isin(np.arange(size(board)), view.ids)
    ids = np.flatnonzero(known | expected.sure)
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
