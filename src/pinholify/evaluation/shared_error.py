"""The error that a corner of the board has in common on all photographs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.observation import ObservedBoard
from pinholify.camera import VirtualCamera
from pinholify.charts import Intrinsics, PlaneChart
from pinholify.refinement.sharing import SharedError, shared_error


def shared_error_of(camera: VirtualCamera, observed: Iterable[ObservedBoard]) -> SharedError:
    """The part of the residuals of boards ``observed`` by ``camera`` that common shifts of the corners explain, px."""
    boards = list(observed)
    if not boards:
        return SharedError(0.0, 1.0)
    return shared_error(
        np.concatenate([each.residual_px * each.board.weights[:, None] for each in boards]),
        np.concatenate([_by_shift(camera.intrinsics, each) for each in boards]),
        np.concatenate([each.board.ids for each in boards]),
        np.repeat(np.arange(len(boards)), [len(each.board.ids) for each in boards]),
    )


def _by_shift(intrinsics: Intrinsics, observed: ObservedBoard) -> Floats:
    """Derivative (m, 2, 3) of weighted residuals in px by shifts of the board's points along its axes, in squares."""
    points = observed.refined.apply(observed.points)
    by_point = PlaneChart(intrinsics).coordinate_jacobian(points)
    return np.asarray(observed.board.whitening @ by_point @ observed.refined.rotation)
