"""Errors of the board itself: shifts of its corners, in its own axes, that all views share.

A seam between two sheets, paper that cockles, a print error: each shifts the same corners of the board in all
photographs, wherever in the image the board is, so the residuals show no structure over the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr  # scipy.stats would take longer to import than to use

from pinholify.arrays import Floats, Ints


@dataclass(frozen=True, slots=True)
class SharedError:
    """The part of the residuals that shifts of the board's corners, shared by all views, explain.

    ``rms`` is its RMS per corner of weight one, in the units of the residuals; ``p_value`` is the probability of as
    much or more where nothing is shared.
    """

    rms: float
    p_value: float


def shared_error(residual: Floats, by_shift: Floats, corner: Ints, view: Ints) -> SharedError:
    """The error that views share at each ``corner`` (N,), as shifts (3,) of the board's points.

    ``residual`` (N, 2) are whitened residuals, ``by_shift`` (N, 2, 3) their derivatives by the board's points in its
    own axes, ``view`` (N,) is the index of the view. The shift that fits all views best explains a part of each
    residual; the statistic is the sum of the products of different views' parts, which has mean zero where nothing is
    shared. The null distribution gives all residuals of a view the same random sign, which preserves the correlation
    within a view (the wild cluster bootstrap of Cameron, Gelbach & Miller 2008, here with its exact variance).
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
    """Roots of the pseudoinverses of symmetric ``matrices`` (n, 3, 3), without the directions that are undetermined."""
    values, vectors = np.linalg.eigh(matrices)
    determined = values > 1e-9 * values[:, -1:]
    scale = np.where(determined, 1.0, 0.0) / np.sqrt(np.where(determined, values, 1.0))
    return np.asarray(scale[:, :, None] * vectors.transpose(0, 2, 1))
