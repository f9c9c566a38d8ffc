"""Lens-like trends: radial about a free centre, on the plane or in angles.

With R(d) = d T(κ r²) (1 + k₁ r² + … + k_n r²ⁿ) + 2 (p·d) d + |d|² (p + q), r² = d_u²/ρ + ρ d_v², two directions of
the same idea:

- undistorting: c = A R(w − w₀) + b, what an effect on the image needs, exact for none and good for all;
- distorting: w = w₀ + R(A (c − b)), the way of Brown's and of Kannala and Brandt's models.

T(z) = tan(√z)/√z, continued by tanh(√−z)/√−z, is the radial law of one number that is exact for perspective
and stereographic lenses in angles, and for the field-of-view model (Devernay & Faugeras 2001) on the plane.

p is Brown's decentring (1966), of elements that do not share an axis, and q a thin prism; to first order q = −p is a
sensor that is tilted against the lens.

A = a (1 + s₁, s₂; s₂, 1 − s₁) is symmetric: its antisymmetric part is a roll of the camera, which the boards'
poses hold already. In angles b = 0 for the same reason; on the plane b is the distortion centre's distance
from the perpendicular axis, which a sensor has that is tilted against its lens. Most cameras have square
pixels (s = 0), round and centred lenses (ρ = 1, p = q = 0), no tilt, and no need of κ: the evidence may say so, and
every number less is a better-known camera.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.geometry import inverse_2x2, inverse_of_parts
from pinholify.refinement.trends.base import Angles, Plane, RayChart, Search, Trend

MATRIX_STD = 10.0
ANISOTROPY_STD = 0.001  # pixels are nearly square: what is more has to be told by many corners
CENTRE_STD = 0.3
OFFSET_STD = 0.5
LOG_RATIO_STD = 0.5
TANGENT_STD = 1.0
RADIAL_STD = 1.0
BEND_STD = 0.03  # of p and q
OFF_CENTRE = 0.5  # of the variance of corners, left by rays that grow from the image's middle
SERIES = 1e-3  # |z| below which T is its series
POLE = (np.pi / 2) ** 2
TABLE = np.linspace(0.0, 4.0, 401)  # radii of the table from which the radial inverse starts
NEWTON_STEPS = 3
BEND_STEPS, BEND_TOLERANCE = 10, 1e-13
HIGHEST, HIGHEST_TANGENT = 6, 1  # radial coefficients


def tangent_law(kappa: float, r2: Floats) -> tuple[Floats, Floats]:
    """T(κ r²) and dT/dz there, elementwise; nan from the pole of the tangent on."""
    z = kappa * r2
    near = np.abs(z) < SERIES
    far = np.where(near, 1.0 if kappa >= 0 else -1.0, z)
    if kappa >= 0:
        root = np.sqrt(np.where(far < POLE, far, np.nan))
        value = np.tan(root) / root
    else:
        root = np.sqrt(-far)
        value = np.tanh(root) / root
    slope = (1.0 + far * value**2 - value) / (2.0 * far)
    series = 1.0 + z * (1.0 / 3.0 + z * (2.0 / 15.0 + z * (17.0 / 315.0)))
    series_slope = 1.0 / 3.0 + z * (4.0 / 15.0 + z * (17.0 / 105.0))
    return np.where(near, series, value), np.where(near, series_slope, slope)


@dataclass(frozen=True, slots=True, eq=False)
class Radial:
    """R(d) with ``log_ratio`` log ρ, ``kappa`` κ, coefficients ``k`` (n,), ``decentring`` p and ``prism`` q, (2,)."""

    log_ratio: float
    kappa: float
    k: Floats
    decentring: Floats
    prism: Floats

    @property
    def axes(self) -> Floats:
        """(1/ρ, ρ)."""
        return np.asarray(np.exp([-self.log_ratio, self.log_ratio]))

    def gain(self, r2: Floats) -> Floats:
        """T(κ r²) (1 + Σ k r²ⁱ), elementwise; nan beyond T's pole."""
        return self.gain_and_slope(r2)[0]

    def gain_and_slope(self, r2: Floats) -> tuple[Floats, Floats]:
        """The gain and its derivative by r², elementwise."""
        polynomial, slope = self._polynomial(r2)
        if not self.kappa:
            return polynomial, slope
        law, law_slope = tangent_law(self.kappa, r2)
        return law * polynomial, law * slope + self.kappa * law_slope * polynomial

    def _polynomial(self, r2: Floats) -> tuple[Floats, Floats]:
        """1 + Σ k r²ⁱ and its derivative by r², by Horner's rule."""
        value: Floats = np.zeros_like(r2)
        slope: Floats = value
        for coefficient in self.k[::-1]:
            slope = slope * r2 + value
            value = value * r2 + coefficient
        return 1.0 + value * r2, slope * r2 + value

    def value(self, d: Floats) -> Floats:
        """R(d), (n, 2)."""
        along = self.gain(d**2 @ self.axes) + 2.0 * (d @ self.decentring)
        return np.asarray(d * along[:, None] + (d**2).sum(axis=1)[:, None] * (self.decentring + self.prism))

    def jacobian(self, d: Floats) -> Floats:
        """∂R/∂d, (n, 2, 2)."""
        return self.jacobian_parts(d.T).transpose(2, 0, 1)

    def jacobian_parts(self, d: Floats) -> Floats:
        """∂R/∂d at ``d`` (2, n): (2, 2, n)."""
        gain, slope = self.gain_and_slope(self.axes @ d**2)
        by_along = 2.0 * (slope * self.axes[:, None] * d + self.decentring[:, None])
        jacobian = d[:, None] * by_along + 2.0 * (self.decentring + self.prism)[:, None, None] * d
        along = gain + 2.0 * self.decentring @ d
        jacobian[0, 0] += along
        jacobian[1, 1] += along
        return np.asarray(jacobian)

    def shape_jacobian(self, d: Floats, *, bent: bool) -> Floats:
        """∂R/∂(log ρ, κ, p, q, k) at ``d`` (2, n): (2, 6 + count of k, n); p's and q's are left at zero unless they are
        asked for: ``bent``.
        """
        squares = self.axes[:, None] * d**2
        r2 = squares.sum(axis=0)
        law, law_slope = tangent_law(self.kappa, r2)
        jacobian = np.zeros((2, 6 + len(self.k), d.shape[1]))
        jacobian[:, 0] = d * (self.gain_and_slope(r2)[1] * (squares[1] - squares[0]))
        jacobian[:, 1] = d * (r2 * law_slope * self._polynomial(r2)[0])
        power = d * law
        for column in range(6, jacobian.shape[1]):
            power = power * r2
            jacobian[:, column] = power
        if bent:
            length2 = (d**2).sum(axis=0)
            jacobian[:, 2:4] = 2.0 * d[:, None] * d
            for axis in (0, 1):
                jacobian[axis, 2 + axis] += length2
                jacobian[axis, 4 + axis] = length2
        return jacobian

    def monotone_until(self) -> float:
        """The radius up to which r · gain(r²) grows, at most the table's last."""
        with np.errstate(invalid="ignore"):
            falling = np.flatnonzero(~(np.diff(TABLE * self.gain(TABLE**2)) > 0))
        return float(TABLE[falling[0]] if len(falling) else TABLE[-1])

    def inverse(self, m: Floats) -> Floats:
        """The d with R(d) = ``m`` (n, 2) on the branch around zero; nan beyond it."""
        d = self._radial_inverse(m)
        if not (self.decentring.any() or self.prism.any()):
            return d
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(BEND_STEPS):
                error = m - self.value(d)
                if not np.nanmax(np.abs(error), initial=0.0) > BEND_TOLERANCE:
                    break
                d = d + (inverse_2x2(self.jacobian(d)) @ error[:, :, None])[:, :, 0]
            return np.where(np.abs(m - self.value(d)).max(axis=1, keepdims=True) < 1e-10, d, np.nan)

    def _radial_inverse(self, m: Floats) -> Floats:
        target = np.sqrt(m**2 @ self.axes)
        last = np.searchsorted(TABLE, self.monotone_until(), side="right")
        radii = TABLE[: max(int(last), 2)]
        reached = radii * self.gain(radii**2)
        r = np.interp(target, reached, radii)
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(NEWTON_STEPS):
                gain, slope = self.gain_and_slope(r**2)
                r = r - (r * gain - target) / (gain + 2.0 * r**2 * slope)
            gain = self.gain(r**2)
            valid = (target <= reached[-1]) & (np.abs(r * gain - target) < 1e-10)
            return np.asarray(m * np.where(valid, 1.0 / gain, np.nan)[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The parameters β by their meaning."""

    scale: float
    shape: Floats
    centre: Floats
    offset: Floats
    radial: Radial

    @property
    def matrix(self) -> Floats:
        """A (2, 2)."""
        return self.scale * self.shape

    def matrix_columns(self, m: Floats) -> Floats:
        """∂(A m)/∂(a, s₁, s₂) at ``m`` (2, n): (2, 3, n)."""
        return np.stack([self.shape @ m, self.scale * m * [[1.0], [-1.0]], self.scale * m[::-1]], axis=1)


def _products(matrices: Floats, columns: Floats) -> Floats:
    """``matrices`` (2, 2, n) times ``columns`` (2, p, n): (2, p, n). Point after point in memory this takes far less
    time than a product for each point.
    """
    products: Floats = matrices[:, 0, None] * columns[0]
    products += matrices[:, 1, None] * columns[1]
    return products


def _scale(w: Floats, c: Floats, distorting: bool) -> float:
    """The factor from rays ``c`` to the image ``w``, or from there to rays, by least squares."""
    return float((w * c).sum() / ((c**2).sum() if distorting else (w**2).sum()))


@dataclass(frozen=True, slots=True)
class LensTrend:
    """Either direction, on either chart, with ``order`` radial coefficients, and with or without the other
    numbers.

    β = (a, s₁ s₂ where ``anisotropic``, w₀, b where ``tilted``, log ρ where ``elliptic``, κ where
    ``tangent``, p where ``decentred``, q where ``prismatic``, k₁ … k_n).
    """

    chart: RayChart
    distorting: bool
    order: int
    anisotropic: bool = True
    tilted: bool = True
    elliptic: bool = True
    tangent: bool = True
    decentred: bool = False
    prismatic: bool = False

    @property
    def name(self) -> str:
        """``plane:3`` with the letters of what it has: s for s₁ and s₂, b, r for ρ, t for κ, p, q, as in
        ``plane-d:2+rt``.
        """
        flags = (self.anisotropic, self._has_offset, self.elliptic, self.tangent, self.decentred, self.prismatic)
        letters = "".join(letter for letter, has in zip("sbrtpq", flags, strict=True) if has)
        return f"{self.family}:{self.order}" + (f"+{letters}" if letters else "")

    @property
    def family(self) -> str:
        """The name without the order."""
        return ("plane" if isinstance(self.chart, Plane) else "angle") + ("-d" if self.distorting else "")

    @property
    def _has_offset(self) -> bool:
        return self.tilted and isinstance(self.chart, Plane)

    @property
    def _bends(self) -> bool:
        """Whether there is a radial law, about a centre and with axes."""
        return self.tangent or self.order > 0

    @property
    def _free(self) -> Bools:
        """Which of the full family's parameters are β."""
        flags = [(True, 1), (self.anisotropic, 2), (True, 2), (self._has_offset, 2), (self.elliptic, 1)]
        flags += [(self.tangent, 1), (self.decentred, 2), (self.prismatic, 2), (True, self.order)]
        return np.repeat(*np.array(flags).T).astype(bool)

    def variants(self) -> Iterator[LensTrend]:
        """Itself and all with fewer of the other numbers, of the same order and radial law; no two say the
        same.
        """
        tilted, elliptic = self._has_offset and self._bends, self.elliptic and self._bends
        general = self.anisotropic, tilted, elliptic, self.decentred, self.prismatic
        for s, b, r, p, q in product(*((True, False) if has else (False,) for has in general)):
            if p or not q:  # nothing real has a prism alone
                yield replace(self, anisotropic=s, tilted=b, elliptic=r, decentred=p, prismatic=q)

    def around(self) -> Search:
        """All that is as simple as this, or has one order or more of the other numbers that tell there."""
        highest = HIGHEST_TANGENT if self.tangent else HIGHEST if self.order else 0
        general = replace(
            self,
            order=max(self.order, min(self.order + 1, highest)),
            anisotropic=True,
            tilted=self._bends,
            elliptic=self._bends,
            decentred=True,
            prismatic=True,
        )
        orders = range(max(self.order - 1, 0), general.order + 1)
        return Search(general, tuple(v for n in orders for v in general.of_order(n).variants()))

    def of_order(self, order: int) -> LensTrend:
        """The same with ``order`` radial coefficients."""
        return replace(self, order=order)

    def kept(self, smaller: Trend) -> Bools:
        """Which of β the ``smaller`` trend has too."""
        assert isinstance(smaller, LensTrend)
        inside = np.append(smaller._free, np.zeros(self.order - smaller.order, dtype=bool))
        return np.asarray(inside[self._free])

    @property
    def level(self) -> bool:
        """No: the centre is free."""
        return False

    @property
    def searches(self) -> bool:
        """No: the radial branch around the centre is the one."""
        return False

    @property
    def prior_std(self) -> Floats:
        """Weak everywhere."""
        general = [MATRIX_STD, *[ANISOTROPY_STD] * 2, *[CENTRE_STD] * 2, *[OFFSET_STD] * 2, LOG_RATIO_STD, TANGENT_STD]
        return np.array(general + [BEND_STD] * 4 + [RADIAL_STD] * self.order)[self._free]

    def parts(self, beta: Floats) -> Parts:
        """β (p,) taken apart."""
        free = self._free
        full = np.zeros(len(free))
        full[free] = beta
        a, s1, s2 = full[:3]
        shape = np.array([[1.0 + s1, s2], [s2, 1.0 - s1]])
        radial = Radial(float(full[7]), float(full[8]), full[13:], full[9:11], full[11:13])
        return Parts(a, shape, full[3:5], full[5:7], radial)

    def start(self, w: Floats, c: Floats) -> Floats:
        """A scaled identity by least squares, no distortion, the centre in the image's middle.

        Where rays do not grow from there, as in a part of a larger image, the centre is where they do.
        """
        beta = np.zeros(len(self.prior_std))
        middle_w, middle_c = w.mean(axis=0), c.mean(axis=0)
        spread = w - middle_w
        beta[0] = _scale(w, c, self.distorting)
        if ((w - _scale(w, c, True) * c) ** 2).sum() > OFF_CENTRE * (spread**2).sum():
            beta[0] = _scale(spread, c - middle_c, self.distorting)
            first = 3 if self.anisotropic else 1
            beta[first : first + 2] = middle_w - middle_c * (beta[0] if self.distorting else 1.0 / beta[0])
        return beta

    def resembling(self, other: Trend, beta: Floats) -> Floats | None:
        """None for another chart or direction."""
        if not isinstance(other, LensTrend) or other.family != self.family:
            return None
        full = np.zeros(max(len(self._free), len(other._free)))
        full[: len(other._free)][other._free] = beta
        return full[: len(self._free)][self._free]

    def image(self, beta: Floats, c: Floats, near: Floats) -> Floats:
        """w; ``near`` is not needed."""
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
        columns = np.empty((2, len(self._free), len(w)))
        if self.distorting:
            e = (c - p.offset).T
            m = p.matrix @ e
            inner = p.radial.jacobian_parts(m)
            by_ray = p.matrix @ inner  # A is symmetric
            columns[:, :3] = _products(inner, p.matrix_columns(e))
            columns[:, 7:] = p.radial.shape_jacobian(m, bent=self.decentred)
        else:
            d = (w - p.centre).T
            inner = inverse_of_parts(p.radial.jacobian_parts(d))
            by_ray = np.linalg.inv(p.matrix) @ inner
            columns[:, :3] = -_products(by_ray, p.matrix_columns(p.radial.value(d.T).T))
            columns[:, 7:] = -_products(inner, p.radial.shape_jacobian(d, bent=self.decentred))
        columns[:, 3:5], columns[:, 5:7] = np.eye(2)[:, :, None], -by_ray
        return by_ray.transpose(2, 0, 1), columns[:, self._free].transpose(2, 0, 1)

    def folds(self, beta: Floats, points: Floats) -> bool:
        """Whether the radial part turns back, or the rays end, nearer to the centre than the farthest of ``points``."""
        p = self.parts(beta)
        if p.scale <= 0 or np.linalg.det(p.shape) <= 0:
            return True
        limit = p.radial.monotone_until()
        reach = limit * p.radial.gain(np.array(limit**2)) if self.distorting else limit
        return bool(np.sqrt((points - p.centre) ** 2 @ p.radial.axes).max() >= reach)


def lens_searches(chart: RayChart, distorting: bool, order: int | None) -> list[Search]:
    """One solve for all orders of the polynomial law, and one for each order of the tangent law, which is not
    linear in κ. A given ``order`` is the only one.

    No law at all, which is the same in both directions, is solved apart: near it the centre and the axes of a law may
    be anything, so it does not follow from one.
    """
    general, searches = LensTrend(chart, distorting, HIGHEST if order is None else order, tangent=False), []
    if orders := range(1, HIGHEST + 1) if order is None else [order] if order else []:
        searches.append(Search(general, tuple(v for n in orders for v in general.of_order(n).variants())))
    if order == 0 or (order is None and not distorting):
        none = replace(general, order=0, tilted=False, elliptic=False)
        searches.append(Search(none, tuple(none.variants())))
    if not distorting and isinstance(chart, Angles):
        return searches  # an arc tangent of the radius: no lens has it
    for n in range(HIGHEST_TANGENT + 1) if order is None else [order]:
        tangent = LensTrend(chart, distorting, n)
        searches.append(Search(tangent, tuple(tangent.variants())))
    return searches
