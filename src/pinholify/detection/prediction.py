"""A small Gaussian process from lattice index to pixel: where the next corner of a lattice must be.

Each prediction is conditioned on the nearest known corners: a linear trend with a vague prior plus a squared
exponential with a length scale of a few squares, whose amplitude is estimated from the same corners. The uncertainty
therefore grows where the lens bends the lattice, and with the distance from the known corners (Rasmussen & Williams,
2006, sections 2.2 and 2.7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Floats, Ints

NEAREST_CORNERS = 24
"""Corners that a prediction is conditioned on."""

LENGTH_SCALE = 4.0
"""Of the squared exponential, in squares."""

NUGGET = 1e-5
"""Noise variance ÷ squared amplitude."""

TREND = 1e4
"""Prior variance of the linear trend ÷ squared amplitude: a vague prior."""

PRIOR_AMPLITUDE = 0.2
"""Prior of the squared exponential's amplitude, as a fraction of the spacing."""

PRIOR_WEIGHT = 4.0
"""Number of corners that this prior counts for."""


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Predicted pixels ``uv`` (m, 2) of m lattice indices, with standard deviations ``std`` (m,) px.

    The columns of ``jacobian`` (m, 2, 2) are the steps in px to the next column and to the next row; ``spacing`` (m,)
    is the distance in px to the nearest known corner ÷ the number of lattice steps to it.
    """

    uv: Floats
    std: Floats
    jacobian: Floats
    spacing: Floats


def predict(known: Floats | Ints, uv: Floats, query: Floats | Ints, *, leave_out: bool = False) -> Prediction:
    """The pixels of the indices ``query`` (m, 2), predicted from ``uv`` (n, 2) px of the indices ``known`` (n, 2).

    With ``leave_out`` a known corner is not used for its own prediction.
    """
    offset, place = _nearest(known, uv, np.asarray(query, dtype=np.float64), leave_out=leave_out)
    centre = place.mean(axis=1)
    place = place - centre[:, None]
    cross = _bending((offset**2).sum(axis=2)) + TREND  # The query is the origin of its offsets.
    solved = np.linalg.solve(_kernel(offset), np.concatenate([place, cross[:, :, None]], axis=2))
    alpha, weights = solved[:, :, :2], solved[:, :, 2]
    variance = np.maximum(1 + TREND - (cross * weights).sum(axis=1), NUGGET)
    mean = (cross[:, :, None] * alpha).sum(axis=1)
    spacing = _spacing(offset, place, mean)
    misfit = (place * alpha).sum(axis=(1, 2)) / 2 + PRIOR_WEIGHT * (PRIOR_AMPLITUDE * spacing) ** 2
    amplitude = np.sqrt(misfit / (max(offset.shape[1] - 3, 0) + PRIOR_WEIGHT))
    # The slope is taken half way to the nearest corner: beyond that, bending is extrapolated too far.
    nearest = (offset**2).sum(axis=2).argmin(axis=1)
    halfway = offset[np.arange(len(offset)), nearest] / 2
    jacobian = _slope(offset, alpha, halfway)
    return Prediction(mean + centre, amplitude * np.sqrt(variance), jacobian, spacing)


def local_frames(known: Floats | Ints, uv: Floats) -> tuple[Floats, Floats]:
    """First (n, 2, 2) and second (n, 2, 3) derivatives in px of the predicted pixel at each known corner.

    The last axis of the second derivatives is by column twice, by column and row, and by row twice.
    """
    offset, place = _nearest(known, uv, known.astype(np.float64), leave_out=False)
    alpha = np.linalg.solve(_kernel(offset), place - place.mean(axis=1, keepdims=True))
    jacobian = _slope(offset, alpha, np.zeros((len(offset), 2)))
    i, j = offset[:, :, 0] / LENGTH_SCALE, offset[:, :, 1] / LENGTH_SCALE
    bending = _bending((offset**2).sum(axis=2))
    curvature = np.stack([i * i - 1, i * j, j * j - 1], axis=2) * bending[:, :, None]
    return jacobian, alpha.transpose(0, 2, 1) @ curvature / LENGTH_SCALE**2


def _nearest(known: Floats | Ints, uv: Floats, query: Floats, *, leave_out: bool) -> tuple[Floats, Floats]:
    """Offsets (m, k, 2) of the k nearest known corners from each of ``query`` (m, 2), and their pixels (m, k, 2)."""
    count = min(NEAREST_CORNERS, len(known) - leave_out)
    distance, near = cKDTree(known).query(query, k=np.arange(1, count + leave_out + 1))
    if leave_out:
        # The nearest is the known corner itself, or else the farthest is one too many.
        kept = np.ones(near.shape, dtype=bool)
        kept[np.arange(len(near)), np.where(distance[:, 0] == 0, 0, count)] = False
        near = near[kept].reshape(-1, count)
    return known[near] - query[:, None], uv[near]


def _bending(squared: Floats) -> Floats:
    """The squared exponential of squared distances."""
    return np.asarray(np.exp(squared / (-2 * LENGTH_SCALE**2)))


def _kernel(offset: Floats) -> Floats:
    """Covariances (m, k, k) of the known corners at ``offset`` (m, k, 2), in units of the squared amplitude."""
    products = offset @ offset.transpose(0, 2, 1)
    own = np.einsum("mkk->mk", products)
    bending = _bending(own[:, :, None] + own[:, None] - 2 * products)
    return bending + TREND * (1 + products) + NUGGET * np.eye(offset.shape[1])


def _slope(offset: Floats, alpha: Floats, at: Floats) -> Floats:
    """Jacobian (m, 2, 2) of the mean at ``at`` (m, 2) from each query."""
    apart = offset - at[:, None]
    bending = _bending((apart**2).sum(axis=2))[:, :, None]
    return np.asarray(alpha.transpose(0, 2, 1) @ (bending * apart / LENGTH_SCALE**2 + TREND * offset))


def _spacing(offset: Floats, place: Floats, mean: Floats) -> Floats:
    """Distance (m,) of ``mean`` (m, 2) from the nearest corner of another index ÷ lattice steps to it."""
    steps = np.sqrt((offset**2).sum(axis=2))
    steps[steps == 0] = np.inf
    row, nearest = np.arange(len(offset)), steps.argmin(axis=1)
    return np.asarray(np.linalg.norm(place[row, nearest] - mean, axis=1) / steps[row, nearest])
