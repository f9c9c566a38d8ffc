"""What all boards' corners have in common in the board's own axes: an error of the board, not of the camera.

A seam between two sheets, paper that cockles, a print error: each shifts the same corners of the board in all
photographs, wherever the board stands in them, so that nothing hangs together over the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr  # scipy.stats would take longer to import than to use

from pinholify.arrays import Floats, Ints


@dataclass(frozen=True, slots=True)
class SharedError:
    """``rms_px`` a corner (of weight one) is what boards' residuals owe to shifts of its corners that all boards share,
    ``p_value`` the probability of as much or more where they share none.
    """

    rms_px: float
    p_value: float


def shared_error(residual: Floats, by_shift: Floats, corner: Ints, view: Ints) -> SharedError:
    """How alike the boards' residuals (N, 2) are at each ``corner`` (N,), as shifts (3,) of the board's points.

    Whitened residuals have the derivatives ``by_shift`` (N, 2, 3) by the board's points in its own axes; ``view`` (N,)
    counts the boards. The shift that fits all boards best explains a part of each residual; counted are the products
    of different boards' parts, whose sum has mean zero where nothing is shared. The null distribution gives each
    board's residuals as a whole a random sign, which keeps what is alike within a board (the wild bootstrap of
    clusters, Cameron, Gelbach & Miller 2008, here with its exact variance).
    """
    if not len(residual):
        return SharedError(0.0, 1.0)
    corner = np.unique(corner, return_inverse=True)[1].ravel()
    by_shift = by_shift.transpose(0, 2, 1)
    information = np.zeros((corner.max() + 1, 3, 3))
    np.add.at(information, corner, by_shift @ by_shift.transpose(0, 2, 1))
    parts = np.zeros((view.max() + 1, len(information), 3))
    parts[view, corner] = (_inverse_roots(information)[corner] @ by_shift @ residual[:, :, None])[:, :, 0]
    products = np.einsum("kci,lci->kl", parts, parts, optimize=True)  # of boards
    np.fill_diagonal(products, 0.0)
    shared, chance = float(products.sum()), float(np.sqrt(2.0 * (products**2).sum()))
    p_value = float(ndtr(-shared / chance)) if chance else 1.0
    return SharedError(float(np.sqrt(max(shared, 0.0) / len(residual))), p_value)


def _inverse_roots(matrices: Floats) -> Floats:
    """Roots of the pseudoinverses of symmetric ``matrices`` (n, 3, 3): what few boards do not tell stays out."""
    values, vectors = np.linalg.eigh(matrices)
    told = values > 1e-9 * values[:, -1:]
    scale = np.where(told, 1.0, 0.0) / np.sqrt(np.where(told, values, 1.0))
    return np.asarray(scale[:, :, None] * vectors.transpose(0, 2, 1))
