"""What all boards' corners have in common in the board's own axes: an error of the board, not of the camera.

A seam between two sheets, a bend that no bow describes, a print error: each shifts the same corners of the board in all
photographs, wherever the board stands in them, so that nothing hangs together over the image.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr  # scipy.stats would take longer to import than to use

from pinholify.arrays import Floats
from pinholify.calibration.observation import ObservedBoard
from pinholify.calibration.result import Calibration
from pinholify.charts import PlaneChart


@dataclass(frozen=True, slots=True)
class SharedError:
    """``rms_px`` a corner (of weight one) is what boards' residuals owe to shifts of its corners that all boards share,
    ``p_value`` the probability of as much or more where they share none.
    """

    rms_px: float
    p_value: float


def shared_error(calibration: Calibration, observed: Iterable[ObservedBoard]) -> SharedError:
    """How alike the ``observed`` boards' residuals are at each corner, as shifts (3,) of the board's points.

    The shift that fits all boards best explains a part of each residual; counted are the products of different boards'
    parts, whose sum has mean zero where nothing is shared. The null distribution gives each board's residuals as a
    whole a random sign, which keeps what is alike within a board (the wild bootstrap of clusters, Cameron, Gelbach &
    Miller 2008, here with its exact variance).
    """
    boards = list(observed)
    if not boards:
        return SharedError(0.0, 1.0)
    lattice = np.concatenate([each.board.lattice for each in boards])
    view = np.repeat(np.arange(len(boards)), [len(each.board.lattice) for each in boards])
    corner = np.unique(lattice, axis=0, return_inverse=True)[1].ravel()
    by_shift = np.concatenate([_by_shift(calibration, each) for each in boards]).transpose(0, 2, 1)
    residual = np.concatenate([each.residual_px * each.board.weights[:, None] for each in boards])
    information = np.zeros((corner.max() + 1, 3, 3))
    np.add.at(information, corner, by_shift @ by_shift.transpose(0, 2, 1))
    parts = np.zeros((len(boards), len(information), 3))
    parts[view, corner] = (_inverse_roots(information)[corner] @ by_shift @ residual[:, :, None])[:, :, 0]
    products = np.einsum("kci,lci->kl", parts, parts, optimize=True)  # of boards, px²
    np.fill_diagonal(products, 0.0)
    shared, chance = float(products.sum()), float(np.sqrt(2.0 * (products**2).sum()))
    return SharedError(float(np.sqrt(max(shared, 0.0) / len(corner))), float(ndtr(-shared / chance)) if chance else 1.0)


def _by_shift(calibration: Calibration, observed: ObservedBoard) -> Floats:
    """∂(weighted residual in px)/∂(shift of the board's point in its own axes, squares): (m, 2, 3)."""
    points = observed.refined.apply(calibration.solid(observed.board.lattice))
    by_point = PlaneChart(calibration.camera.intrinsics).coordinate_jacobian(points)
    return np.asarray(observed.board.whitening @ by_point @ observed.refined.rotation)


def _inverse_roots(matrices: Floats) -> Floats:
    """Roots of the pseudoinverses of symmetric ``matrices`` (n, 3, 3): what few boards do not tell stays out."""
    values, vectors = np.linalg.eigh(matrices)
    told = values > 1e-9 * values[:, -1:]
    scale = np.where(told, 1.0, 0.0) / np.sqrt(np.where(told, values, 1.0))
    return np.asarray(scale[:, :, None] * vectors.transpose(0, 2, 1))
