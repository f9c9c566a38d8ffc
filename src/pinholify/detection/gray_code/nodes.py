"""Where the camera sees the nodes of a screen: a local fit to all decoded pixels around each.

Over the ``spacing`` × ``spacing`` screen pixels around a node, its cell, the screen position is fitted as a quadratic
of the camera pixel; the node lies where that polynomial has its value. The fit runs in this direction because camera
pixels are exact, and the noise (with a Gray code its rounding) is in the screen position. All cells are fitted at
once, by sums over their pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats, Ints, joined, selected
from pinholify.board import Screen, size
from pinholify.detection.gray_code.screen_map import ScreenMap

MIN_PIXELS = 16
"""Pixels that a cell needs: enough for a quadratic and an estimate of its noise."""

AMPLE_FACTOR = 1.5
"""Times MIN_PIXELS that a median cell should have when a spacing is recommended."""

COVERED_SHARE = 0.6
"""Share of a whole cell's pixels below which the cell is cut by an edge, of a hand or of the image."""

MAX_MEDIAN_DEVIATIONS = 4.0
"""Median deviations from a cell's median position in the image beyond which a pixel does not belong to the cell."""

OUTLIER_STDS = 4.0
"""Standard deviations of a cell's residuals beyond which a pixel is dropped."""

ROUNDS = 3
"""Fits of each cell, with outliers dropped in between."""

NEWTON_STEPS = 4
CHUNK_PIXELS = 400_000
"""Pixels fitted at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Nodes ``ids`` (n,) of a screen, seen at ``uv`` (n, 2) px with a standard deviation ``std`` (n,) px per axis."""

    ids: Ints
    uv: Floats
    std: Floats

    def select(self, keep: Bools) -> Nodes:
        """The nodes where ``keep`` (n,) is true."""
        return selected(self, keep)


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Pixels ``uv`` (p, 2) sorted by cell; those of the cell ``ids`` (n,) begin at ``starts`` (n,).

    ``xy`` (p, 2) are their positions on the screen in spacings from the cell's node.
    """

    ids: Ints
    starts: Ints
    uv: Floats
    xy: Floats

    def counts(self) -> Ints:
        return np.diff(np.append(self.starts, len(self.uv)))

    def sums(self, values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, self.starts, axis=0))

    def select(self, keep: Bools) -> _Cells:
        """The pixels where ``keep`` (p,) is true, without cells that are left with too few."""
        enough = self.sums(keep.astype(np.int64)) >= MIN_PIXELS
        counts = self.counts()
        keep = keep & np.repeat(enough, counts)
        left = self.sums(keep.astype(np.int64))[enough]
        starts = np.concatenate([[0], np.cumsum(left)[:-1]]).astype(np.int64)
        return _Cells(self.ids[enough], starts[: len(left)], self.uv[keep], self.xy[keep])


def fit_nodes(decoded: ScreenMap, screen: Screen) -> Nodes:
    """The nodes of ``screen`` that ``decoded`` shows, each fitted separately; some may be wrong."""
    parts = [_fit(cells) for cells in _cells(decoded, screen)]
    return joined(parts or [Nodes(np.empty(0, np.int64), np.empty((0, 2)), np.empty(0))])


def least_spacing(decoded: ScreenMap, screen: Screen) -> int:
    """The smallest spacing (screen px) at which the cells of ``screen`` have enough pixels of ``decoded``."""
    counts = np.concatenate([cells.counts() for cells in _cells(decoded, screen)] or [np.empty(0, np.int64)])
    if not len(counts):
        return screen.spacing
    return int(np.ceil(screen.spacing * np.sqrt(AMPLE_FACTOR * MIN_PIXELS / np.median(counts))))


def _cells(decoded: ScreenMap, screen: Screen) -> Iterator[_Cells]:
    """The decoded pixels sorted by cell, a number of cells at a time."""
    v, u = np.nonzero(np.isfinite(decoded.x))
    x, y = ((place[v, u] + 0.5) / screen.spacing for place in (decoded.x, decoded.y))
    column, row = x.astype(np.int64), y.astype(np.int64)
    cell = np.where((column < screen.columns) & (row < screen.rows), row * screen.columns + column, size(screen))
    order = np.lexsort((u, cell))
    order = order[: np.searchsorted(cell[order], size(screen))]
    ids, starts = np.unique(cell[order], return_index=True)
    for first, last in _chunks(starts, len(order)):
        ends = np.append(starts, len(order))
        some = order[starts[first] : ends[last]]
        uv = np.column_stack([u[some], v[some]]).astype(np.float64)
        xy = np.column_stack([x[some] - column[some], y[some] - row[some]]) - 0.5
        yield _Cells(ids[first:last], starts[first:last] - starts[first], uv, xy)


def _chunks(starts: Ints, total: int) -> Iterator[tuple[int, int]]:
    """Ranges of cells of about ``CHUNK_PIXELS`` pixels each."""
    bounds = np.searchsorted(starts, np.arange(0, total, CHUNK_PIXELS))
    bounds = np.unique(np.append(bounds, len(starts)))
    yield from zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)


def _fit(cells: _Cells) -> Nodes:
    cells = cells.select(_near_median(cells))
    for i in range(ROUNDS):
        if not len(cells.ids):
            return Nodes(cells.ids, np.empty((0, 2)), np.empty(0))
        fit = _quadratics(cells)
        length = np.linalg.norm(fit.residual, axis=1)
        if i + 1 < ROUNDS:
            cells = cells.select(length <= OUTLIER_STDS * np.repeat(fit.noise, cells.counts()))
    place, slope = _newton(fit.coefficients)
    leverage = _leverage(fit.gram, _monomials(place))
    inverse = np.linalg.inv(slope) * fit.scale[:, None, None]
    std = fit.noise * np.sqrt(leverage * (inverse**2).sum(axis=(1, 2)) / 2.0)
    whole = np.abs(np.linalg.det(inverse))  # px² that a cell takes in the image
    good = (np.linalg.norm(place, axis=1) < 1.0) & (cells.counts() > COVERED_SHARE * whole)
    good &= np.isfinite(std) & (std > 0)
    uv = fit.centre + place * fit.scale[:, None]
    return Nodes(cells.ids, uv, std).select(good)


def _near_median(cells: _Cells) -> Bools:
    """Which pixels (p,) lie near the median of their cell: a wrong code may come from anywhere."""
    keep = np.ones(len(cells.uv), dtype=bool)
    counts = cells.counts()
    for axis in (0, 1):
        distance = np.abs(cells.uv[:, axis] - np.repeat(_medians(cells, cells.uv[:, axis]), counts))
        keep &= distance <= np.repeat(MAX_MEDIAN_DEVIATIONS * _medians(cells, distance) + 1.0, counts)
    return keep


def _medians(cells: _Cells, values: Floats) -> Floats:
    """The median of ``values`` (p,) in each cell."""
    counts = cells.counts()
    order = np.lexsort((values, np.repeat(np.arange(len(counts)), counts)))
    return np.asarray(values[order[cells.starts + counts // 2]])


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """The quadratics of n cells: ``coefficients`` (n, 6, 2) of the monomials of (uv − ``centre``)/``scale``.

    ``gram`` (n, 6, 6) is the monomials' Gram matrix; the ``residual`` (p, 2) of each pixel and the ``noise`` (n,) per
    axis are in spacings.
    """

    centre: Floats
    scale: Floats
    coefficients: Floats
    gram: Floats
    residual: Floats
    noise: Floats


def _quadratics(cells: _Cells) -> _Fit:
    counts = cells.counts()
    centre = cells.sums(cells.uv) / counts[:, None]
    offset = cells.uv - np.repeat(centre, counts, axis=0)
    scale = np.sqrt(cells.sums((offset**2).sum(axis=1)) / counts)
    rows = _monomials(offset / np.repeat(scale, counts)[:, None])
    gram = np.empty((len(counts), 6, 6))
    for i in range(6):
        gram[:, i] = cells.sums(rows[:, i : i + 1] * rows)
    right = np.stack([cells.sums(rows * cells.xy[:, axis, None]) for axis in (0, 1)], axis=2)
    gram[:, range(6), range(6)] += 1e-9 * counts[:, None]  # regular for collinear pixels too, which are dropped later
    coefficients: Floats = np.asarray(np.linalg.solve(gram, right), dtype=np.float64)
    residual = cells.xy - np.einsum("pi,pij->pj", rows, np.repeat(coefficients, counts, axis=0))
    noise = np.sqrt(cells.sums((residual**2).sum(axis=1)) / (2.0 * (counts - 6)))
    return _Fit(centre, scale, coefficients, gram, residual, noise)


def _monomials(p: Floats) -> Floats:
    """The monomials 1, a, b, a², ab, b² (n, 6) of points (n, 2)."""
    a, b = p.T
    return np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=1)


def _newton(coefficients: Floats) -> tuple[Floats, Floats]:
    """The zeros (n, 2) of the quadratics (n, 6, 2) near the origin, and the derivatives (n, 2, 2) there."""
    place = np.zeros((len(coefficients), 2))
    for _ in range(NEWTON_STEPS):
        value = np.einsum("ni,nij->nj", _monomials(place), coefficients)
        slope = _slope(coefficients, place)
        place = place - np.clip(np.linalg.solve(slope, value[:, :, None])[:, :, 0], -1.0, 1.0)
    return place, _slope(coefficients, place)


def _slope(coefficients: Floats, place: Floats) -> Floats:
    a, b = place[:, :1], place[:, 1:]
    c = coefficients
    by_a = c[:, 1] + 2.0 * a * c[:, 3] + b * c[:, 4]
    by_b = c[:, 2] + a * c[:, 4] + 2.0 * b * c[:, 5]
    return np.stack([by_a, by_b], axis=2) + 1e-12 * np.eye(2)


def _leverage(gram: Floats, monomials: Floats) -> Floats:
    """Variance (n,) of the fit at a point of given ``monomials`` (n, 6) ÷ variance of the noise."""
    solved = np.linalg.solve(gram, monomials[:, :, None])[:, :, 0]
    return np.asarray((monomials * solved).sum(axis=1))
