"""The error that a corner of the board has in common on all photographs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.observation import ObservedBoard
from pinholify.calibration.result import Calibration
from pinholify.charts import PlaneChart
from pinholify.refinement.sharing import SharedError, shared_error


def shared_error_of(calibration: Calibration, observed: Iterable[ObservedBoard]) -> SharedError:
    """The part of the residuals of the ``observed`` boards that common shifts of the board's corners explain."""
    boards = list(observed)
    if not boards:
        return SharedError(0.0, 1.0)
    places = np.concatenate([each.board.lattice for each in boards])
    return shared_error(
        np.concatenate([each.residual_px * each.board.weights[:, None] for each in boards]),
        np.concatenate([_by_shift(calibration, each) for each in boards]),
        np.unique(places, axis=0, return_inverse=True)[1].ravel(),
        np.repeat(np.arange(len(boards)), [len(each.board.lattice) for each in boards]),
    )


def _by_shift(calibration: Calibration, observed: ObservedBoard) -> Floats:
    """Derivative (m, 2, 3) of weighted residuals in px by shifts of the board's points along its axes, in squares."""
    points = observed.refined.apply(calibration.solid(observed.board.lattice))
    by_point = PlaneChart(calibration.camera.intrinsics).coordinate_jacobian(points)
    return np.asarray(observed.board.whitening @ by_point @ observed.refined.rotation)
