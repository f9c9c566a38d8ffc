"""Spline surfaces with evenly spaced control points, and camera maps made of them.

They are used to import and export cameras of other programs: an imported camera's map, and mrcal's splined model.
Surfaces are linear in their control points, so a fit is one sparse solve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from pinholify.arrays import Bools, Floats, Ints, frozen
from pinholify.geometry import ConvexRegion, grid_points
from pinholify.gp.maps import Nearby, newton_inverse, propagated

SMOOTHING = 1e-9  # of the mean weight of a control point: only effective where there are no data

WORST_PLACES, CLOSER_LOOKS = 200, 3  # points around which errors are evaluated more finely, and how often
AROUND = grid_points(np.arange(-4.0, 5.0), np.arange(-4.0, 5.0)) / 4.0


@dataclass(frozen=True, slots=True, eq=False)
class SplineSurface:
    """A uniform B-spline surface of ``degree`` 2 or 3 from points of the plane to m values.

    The first of the control points ``control`` (rows, columns, m) is at ``origin`` (2,), the others at steps of
    ``spacing`` (2,) along x and y. Beyond the last but one control points the nearest patch's polynomial continues.
    """

    origin: Floats
    spacing: Floats
    control: Floats
    degree: int = 3

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", frozen(self.origin, (2,)))
        object.__setattr__(self, "spacing", frozen(self.spacing, (2,)))
        object.__setattr__(self, "control", frozen(self.control, (None, None, None)))
        if self.degree not in WEIGHTS:
            raise ValueError(f"a spline of degree {self.degree} was requested; the degree must be 2 or 3")
        if min(self.control.shape[:2]) <= self.degree:
            raise ValueError(f"{self.control.shape[:2]} control points are too few for degree {self.degree}")

    def value(self, p: Floats) -> Floats:
        """The surface at ``p`` (n, 2): (n, m)."""
        index, (x, y), _ = self._patches(p)
        return np.asarray(np.einsum("nijm,ni,nj->nm", self._nearby(index), y, x))

    def jacobian(self, p: Floats) -> Floats:
        """∂value/∂p at ``p`` (n, 2): (n, m, 2)."""
        index, (x, y), (dx, dy) = self._patches(p)
        nearby = self._nearby(index)
        slopes = [np.einsum("nijm,ni,nj->nm", nearby, a, b) for a, b in ((y, dx), (dy, x))]
        return np.stack(slopes, axis=2) / self.spacing

    def design(self, p: Floats) -> sparse.csr_array:
        """The matrix (n, rows · columns) that takes control points, row by row, to values at ``p`` (n, 2)."""
        index, (x, y), _ = self._patches(p)
        columns = np.ravel_multi_index(self._indices(index), self.control.shape[:2]).reshape(len(p), -1)
        weights = (y[:, :, None] * x[:, None, :]).reshape(len(p), -1)
        rows = np.arange(len(p) + 1) * weights.shape[1]
        size = self.control.shape[0] * self.control.shape[1]
        return sparse.csr_array((weights.ravel(), columns.ravel(), rows), shape=(len(p), size))

    def _patches(self, p: Floats) -> tuple[Ints, tuple[Floats, Floats], tuple[Floats, Floats]]:
        """First control point (n, 2: column, row) of each point's patch, weights along x and y, and their slopes."""
        place = (p - self.origin) / self.spacing
        before = (self.degree - 1) / 2.0
        last = np.array(self.control.shape[1::-1]) - self.degree - 1
        first = np.clip(np.floor(np.nan_to_num(place) - before), 0, last).astype(np.int64)
        (x, dx), (y, dy) = (WEIGHTS[self.degree](t) for t in (place - first - before).T)
        return first, (x, y), (dx, dy)

    def _indices(self, first: Ints) -> tuple[Ints, Ints]:
        """Rows (n, k, 1) and columns (n, 1, k) of the control points of patches."""
        offsets = np.arange(self.degree + 1)
        return first[:, 1, None, None] + offsets[:, None], first[:, 0, None, None] + offsets

    def _nearby(self, first: Ints) -> Floats:
        return np.asarray(self.control[self._indices(first)])


def _quadratic(t: Floats) -> tuple[Floats, Floats]:
    """Weights (n, 3) of three control points and their slopes, t from 0 to 1 over the patch around the middle one."""
    weights = [(1.0 - t) ** 2 / 2.0, 0.5 + t - t**2, t**2 / 2.0]
    return np.stack(weights, axis=1), np.stack([t - 1.0, 1.0 - 2.0 * t, t], axis=1)


def _cubic(t: Floats) -> tuple[Floats, Floats]:
    """Weights (n, 4) of four control points and their slopes, t from 0 to 1 between the inner two."""
    s = 1.0 - t
    weights = [s**3, 3.0 * t**3 - 6.0 * t**2 + 4.0, 3.0 * s**3 - 6.0 * s**2 + 4.0, t**3]
    slopes = [-(s**2), t * (3.0 * t - 4.0), -s * (3.0 * s - 4.0), t**2]
    return np.stack(weights, axis=1) / 6.0, np.stack(slopes, axis=1) / 2.0


WEIGHTS = {2: _quadratic, 3: _cubic}
"""Uniform B-splines (de Boor, *A Practical Guide to Splines*, ch. X) by degree."""


def fitted(empty: SplineSurface, p: Floats, values: Floats) -> SplineSurface:
    """``empty`` with the control points that fit ``values`` (n, m) at ``p`` (n, 2) by least squares.

    Where there are no data the surface continues straight: second differences of the control points are lightly
    penalised (P-splines, Eilers & Marx 1996).
    """
    design = empty.design(p)
    normal = design.T @ design
    rows, columns = empty.control.shape[:2]
    bending = sparse.kron(sparse.eye_array(rows), _bending(columns)) + sparse.kron(
        _bending(rows), sparse.eye_array(columns)
    )
    light = SMOOTHING * normal.diagonal().mean()
    control = spsolve((normal + light * bending).tocsc(), design.T @ values)
    return replace(empty, control=control.reshape(rows, columns, -1))


def _bending(count: int) -> sparse.csr_array:
    """The matrix (count, count) of a row's summed squared second differences."""
    second = sparse.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count))
    return second.T @ second


def worst_places(error: Callable[[Floats], Floats], grid: Floats, spacing: float) -> Floats:
    """Points (n, 2) around those of a ``grid`` (m, 2) at which ``error`` is largest, dense enough to find its maximum.

    ``error`` maps points (k, 2) to errors (k,), nan where they do not count. A fit is worst between its data and at
    their border, which a grid of a given ``spacing`` misses: the spacing of these points is 64 times smaller.
    """
    places = grid
    for _ in range(CLOSER_LOOKS):
        worst = np.argsort(-np.nan_to_num(error(places), nan=-1.0))[:WORST_PLACES]
        places = (places[worst][:, None] + spacing * AROUND).reshape(-1, 2)
        spacing /= 4.0
    return places


def rounded_up(value: float) -> str:
    """A positive ``value`` as text with two significant digits, rounded up, so that it remains an upper bound."""
    step = 10.0 ** (np.floor(np.log10(value)) - 1.0)
    return f"{np.ceil(value / step * (1.0 - 1e-12)) * step:.2g}"


@dataclass(frozen=True, slots=True, eq=False)
class SplineMap:
    """A :class:`pinholify.gp.maps.PlaneMap` taken from another program's camera: q by a ``surface`` over the image.

    ``std_px`` is the RMS error per axis, in px, with which the surface reproduces that camera; how well that camera was
    calibrated is not known. Pixels outside ``known`` are nan: that camera sees nothing there, or has no data. If it is
    None, the surface is extrapolated without limit.
    """

    surface: SplineSurface
    std_px: float
    known: ConvexRegion | None = None
    disagreement: ClassVar[float] = 1.0

    def value(self, uv: Floats) -> Floats:
        """q (n, 2) of pixels ``uv`` (n, 2)."""
        return np.where(self._sees(uv)[:, None], self.surface.value(uv), np.nan)

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv (n, 2, 2)."""
        return np.where(self._sees(uv)[:, None, None], self.surface.jacobian(uv), np.nan)

    def covariance(self, uv: Floats) -> Floats:
        """Covariance (n, 2, 2) of q for a pixel shifted by ``std_px`` along each axis."""
        jacobian = self.jacobian(uv)
        return np.asarray(self.std_px**2 * jacobian @ jacobian.transpose(0, 2, 1))

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """The same as :meth:`covariance`: the fit includes no rotation."""
        return self.covariance(uv)

    def virtual_covariance(self, uv: Floats, by_q: Floats, by_k: Floats) -> Floats:
        """Covariance (n, 2, 2) of virtual points; K is taken from the other program without an uncertainty."""
        return propagated(by_q, self.covariance(uv))

    def covariance_root(self, uv: Floats) -> Floats:
        """Empty (n, 2, 0)."""
        return np.empty((len(uv), 2, 0))

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """uv (n, 2) of ``q`` (n, 2) by Newton's method, whose steps may leave ``known`` and return."""
        uv = newton_inverse(self.surface, q, *nearby(q))
        return np.where(self._sees(uv)[:, None], uv, np.nan)

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Zeros (draws, n, 2): the data came from another program's model, without noise."""
        return np.zeros((draws, *uv.shape))

    def _sees(self, uv: Floats) -> Bools:
        """Which pixels (n, 2) are known."""
        return np.ones(len(uv), dtype=bool) if self.known is None else self.known.contains(uv)
