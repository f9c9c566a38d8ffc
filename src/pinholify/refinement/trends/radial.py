"""Lens-like trends: radial about a free centre with a free ratio of its axes, on the plane or in angles.

With R(d) = d (1 + k₁ r² + … + k_n r²ⁿ), r² = d_u²/ρ + ρ d_v², two directions of the same idea:

- undistorting: c = A R(w − w₀) + b, what an effect on the image needs, exact for none and good for all;
- distorting: w = w₀ + R(A (c − b)), the way of Brown's and of Kannala and Brandt's models.

A is symmetric: its antisymmetric part is a roll of the camera, which the boards' poses hold already. In
angles b = 0 for the same reason; on the plane b is the distortion centre's distance from the perpendicular
axis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.refinement.trends.base import Angles, Plane, RayChart, inverse_2x2

MATRIX_STD = 10.0
CENTRE_STD = 0.3
OFFSET_STD = 0.5
LOG_RATIO_STD = 0.5
RADIAL_STD = 1.0
TABLE = np.linspace(0.0, 4.0, 401)  # radii of the table from which the radial inverse starts
NEWTON_STEPS = 4
MARGIN = 1.1  # of the image, in which a trend may not fold


@dataclass(frozen=True, slots=True, eq=False)
class Radial:
    """R(d) with ``log_ratio`` log ρ and coefficients ``k`` (n,)."""

    log_ratio: float
    k: Floats

    @property
    def axes(self) -> Floats:
        """(1/ρ, ρ)."""
        return np.asarray(np.exp([-self.log_ratio, self.log_ratio]))

    def gain(self, r2: Floats) -> Floats:
        """1 + Σ k rⁱ², elementwise."""
        return np.asarray(np.polynomial.polynomial.polyval(r2, np.append(1.0, self.k)))

    def gain_slope(self, r2: Floats) -> Floats:
        """d gain/d r², elementwise."""
        return np.asarray(np.polynomial.polynomial.polyval(r2, self.k * np.arange(1, len(self.k) + 1)))

    def value(self, d: Floats) -> Floats:
        """R(d), (n, 2)."""
        return np.asarray(d * self.gain(d**2 @ self.axes)[:, None])

    def jacobian(self, d: Floats) -> Floats:
        """∂R/∂d, (n, 2, 2)."""
        r2 = d**2 @ self.axes
        slope = self.gain_slope(r2)[:, None, None] if len(self.k) else 0.0
        return (
            self.gain(r2)[:, None, None] * np.eye(2)
            + slope * d[:, :, None] * (2.0 * d * self.axes)[:, None, :]
        )

    def shape_jacobian(self, d: Floats) -> Floats:
        """∂R/∂(log ρ, k), (n, 2, 1 + n)."""
        squares = d**2 * self.axes
        r2 = squares.sum(axis=1)
        slope = self.gain_slope(r2) if len(self.k) else np.zeros(len(d))
        factors = np.column_stack(
            [slope * (squares[:, 1] - squares[:, 0]), r2[:, None] ** np.arange(1, len(self.k) + 1)]
        )
        return np.asarray(d[:, :, None] * factors[:, None, :])

    def monotone_until(self) -> float:
        """The radius up to which r · gain(r²) grows, at most the table's last."""
        falling = np.flatnonzero(np.diff(TABLE * self.gain(TABLE**2)) <= 0)
        return float(TABLE[falling[0]] if len(falling) else TABLE[-1])

    def inverse(self, m: Floats) -> Floats:
        """The d with R(d) = ``m`` (n, 2) on the branch around zero; nan beyond it."""
        target = np.sqrt(m**2 @ self.axes)
        last = np.searchsorted(TABLE, self.monotone_until(), side="right")
        radii = TABLE[: max(int(last), 2)]
        reached = radii * self.gain(radii**2)
        r = np.interp(target, reached, radii)
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(NEWTON_STEPS):
                r2 = r**2
                slope = self.gain(r2) + (2.0 * r2 * self.gain_slope(r2) if len(self.k) else 0.0)
                r = r - (r * self.gain(r2) - target) / slope
            valid = (target <= reached[-1]) & (np.abs(r * self.gain(r**2) - target) < 1e-10)
            return np.asarray(m * np.where(valid, 1.0 / self.gain(r**2), np.nan)[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The parameters β by their meaning."""

    matrix: Floats
    centre: Floats
    offset: Floats
    radial: Radial


@dataclass(frozen=True, slots=True)
class LensTrend:
    """Either direction, on either chart, with ``order`` radial coefficients."""

    chart: RayChart
    distorting: bool
    order: int

    @property
    def name(self) -> str:
        """``plane:3``, ``angle:2``, and ``plane-d:3``, ``angle-d:2`` for the distorting direction."""
        return f"{self.family}:{self.order}"

    @property
    def family(self) -> str:
        """The name without the order."""
        return ("plane" if self._offset else "angle") + ("-d" if self.distorting else "")

    @property
    def _offset(self) -> bool:
        return isinstance(self.chart, Plane)

    def of_order(self, order: int) -> LensTrend:
        """The same direction and chart with ``order`` radial coefficients."""
        return replace(self, order=order)

    def kept(self, order: int) -> Bools:
        """All but the higher radial coefficients."""
        size = len(self.prior_std)
        return np.arange(size) < size - self.order + order

    @property
    def level(self) -> bool:
        """No: the centre is free."""
        return False

    @property
    def prior_std(self) -> Floats:
        """Weak everywhere."""
        offset = [OFFSET_STD] * (2 if self._offset else 0)
        shape = [LOG_RATIO_STD, *[RADIAL_STD] * self.order]
        return np.array([MATRIX_STD] * 3 + [CENTRE_STD] * 2 + offset + shape)

    def parts(self, beta: Floats) -> Parts:
        """β (p,) taken apart."""
        matrix = np.array([[beta[0], beta[1]], [beta[1], beta[2]]])
        offset = beta[5:7] if self._offset else np.zeros(2)
        first = 7 if self._offset else 5
        return Parts(matrix, beta[3:5], offset, Radial(float(beta[first]), beta[first + 1 :]))

    def start(self, w: Floats, c: Floats) -> Floats:
        """A scaled identity by least squares, no distortion, the centre in the image's middle."""
        ratio = float((w * c).sum() / ((c**2).sum() if self.distorting else (w**2).sum()))
        beta = np.zeros(len(self.prior_std))
        beta[[0, 2]] = ratio
        return beta

    def image(self, beta: Floats, c: Floats, near: Floats) -> Floats:
        """w; ``near`` is not needed, the radial branch around the centre is the one."""
        p = self.parts(beta)
        if self.distorting:
            return p.radial.value((c - p.offset) @ p.matrix) + p.centre
        return p.radial.inverse((c - p.offset) @ np.linalg.inv(p.matrix)) + p.centre

    def ray(self, beta: Floats, w: Floats) -> Floats:
        """c."""
        p = self.parts(beta)
        if self.distorting:
            return p.radial.inverse(w - p.centre) @ np.linalg.inv(p.matrix) + p.offset
        return p.radial.value(w - p.centre) @ p.matrix + p.offset

    def jacobians(self, beta: Floats, w: Floats, c: Floats) -> tuple[Floats, Floats]:
        """∂w/∂c and ∂w/∂β."""
        p = self.parts(beta)
        if self.distorting:
            e = c - p.offset
            m = e @ p.matrix
            inner = p.radial.jacobian(m)
            by_ray = inner @ p.matrix
            by_matrix, by_shape = inner @ _symmetric_columns(e), p.radial.shape_jacobian(m)
        else:
            d = w - p.centre
            by_ray = inverse_2x2(p.matrix @ p.radial.jacobian(d))
            by_matrix = -by_ray @ _symmetric_columns(p.radial.value(d))
            by_shape = -by_ray @ (p.matrix @ p.radial.shape_jacobian(d))
        by_centre = np.broadcast_to(np.eye(2), (len(w), 2, 2))
        by_offset = -by_ray if self._offset else by_ray[:, :, :0]
        return by_ray, np.concatenate([by_matrix, by_centre, by_offset, by_shape], axis=2)

    def folds(self, beta: Floats, half_size: Floats) -> bool:
        """Whether the radial part turns back, or the rays end, inside the image."""
        p = self.parts(beta)
        if np.linalg.det(p.matrix) <= 0:
            return True
        corners = MARGIN * half_size * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) - p.centre
        limit = p.radial.monotone_until()
        if not self.distorting:
            return bool(np.sqrt(corners**2 @ p.radial.axes).max() >= limit)
        return bool(np.sqrt(corners**2 @ p.radial.axes).max() >= limit * p.radial.gain(np.array(limit**2)))


def _symmetric_columns(m: Floats) -> Floats:
    """∂(A m)/∂(a₁₁, a₁₂, a₂₂) of a symmetric A: (n, 2, 3)."""
    zero = np.zeros(len(m))
    return np.stack(
        [np.stack([m[:, 0], m[:, 1], zero], axis=1), np.stack([zero, m[:, 0], m[:, 1]], axis=1)], axis=1
    )


def plane_lens(order: int) -> LensTrend:
    """Undistorting, on the plane."""
    return LensTrend(Plane(), False, order)


def plane_lens_distorting(order: int) -> LensTrend:
    """Distorting, on the plane."""
    return LensTrend(Plane(), True, order)


def angle_lens(order: int) -> LensTrend:
    """Undistorting, in angles."""
    return LensTrend(Angles(), False, order)


def angle_lens_distorting(order: int) -> LensTrend:
    """Distorting, in angles."""
    return LensTrend(Angles(), True, order)
