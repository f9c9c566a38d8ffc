"""Lens-like trends: radial about a free centre, on the plane or in angles.

With R(d) = d T(κ r²) (1 + k₁ r² + … + k_n r²ⁿ) + 2 (p·d) d + |d|² (p + q) and r² = d_u²/ρ + ρ d_v², a trend has one of
two directions:

- undistorting: c = A R(w − w₀) + b, rays as a function of the image, which approximates all lenses well;
- distorting: w = w₀ + R(A (c − b)), the direction of Brown's and of Kannala and Brandt's models.

T(z) = tan(√z)/√z, continued by tanh(√−z)/√−z, is a radial law with one parameter that is exact for perspective and
stereographic lenses in angles, and for the field-of-view model (Devernay & Faugeras 2001) on the plane.

p is Brown's decentring (1966), of elements that do not share an axis, and q a thin prism; to first order q = −p is a
sensor that is tilted against the lens.

A = a (1 + s₁, s₂; s₂, 1 − s₁) is symmetric: its antisymmetric part would be a roll of the camera, which the boards'
poses represent already. In angles b = 0 for the same reason; on the plane b is the offset of the distortion centre from
the perpendicular axis, as of a sensor that is tilted against its lens. Most cameras have square pixels (s = 0), round
and centred lenses (ρ = 1, p = q = 0), no tilt, and need no κ. The evidence decides which of these parameters are free:
each one that is not makes the camera better known.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.geometry import inverse_2x2, inverse_of_parts
from pinholify.refinement.trends.base import Angles, Plane, RayChart, Search, Trend

# standard deviations of the priors
MATRIX_STD = 10.0
ANISOTROPY_STD = 0.001  # pixels are nearly square: only many corners together can show otherwise
CENTRE_STD = 0.3
OFFSET_STD = 0.5
LOG_RATIO_STD = 0.5
TANGENT_STD = 1.0
RADIAL_STD = 1.0
BEND_STD = 0.03  # of p and q

OFF_CENTRE_SHARE = 0.5  # of the corners' variance; if rays about the image's middle leave more, the centre is elsewhere
SERIES_LIMIT = 1e-3  # |z| below which T is computed by its series
TANGENT_POLE = (np.pi / 2) ** 2  # the z where T ends
RADIUS_TABLE = np.linspace(0.0, 4.0, 401)  # radii, in half diagonals, of the table from which the radial inverse starts
NEWTON_STEPS = 3  # of the radial inverse, from the table
BEND_STEPS, BEND_TOLERANCE = 10, 1e-13  # of the inverse with decentring or prism
INVERSE_ERROR = 1e-10  # largest error of an inverse that has converged
MAX_ORDER, MAX_TANGENT_ORDER = 6, 1  # numbers of radial coefficients, without and with κ


def tangent_law(kappa: float, r2: Floats) -> tuple[Floats, Floats]:
    """T(z) and dT/dz at z = κ r², elementwise for ``r2``; nan from the pole of the tangent on."""
    z = kappa * r2
    near = np.abs(z) < SERIES_LIMIT
    far = np.where(near, 1.0 if kappa >= 0 else -1.0, z)
    if kappa >= 0:
        root = np.sqrt(np.where(far < TANGENT_POLE, far, np.nan))
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
    """The map R with ``log_ratio`` log ρ, ``kappa`` κ, ``k`` (n,), ``decentring`` p and ``prism`` q, both (2,)."""

    log_ratio: float
    kappa: float
    k: Floats
    decentring: Floats
    prism: Floats

    @property
    @np.errstate(over="ignore")  # a step too far: such a map sees no corner
    def axes(self) -> Floats:
        """The factors (1/ρ, ρ) of the squared coordinates."""
        return np.asarray(np.exp([-self.log_ratio, self.log_ratio]))

    def gain(self, r2: Floats) -> Floats:
        """The radial factor T(κ r²) (1 + Σ k r²ⁱ), elementwise for ``r2``; nan beyond the pole of T."""
        return self.gain_and_slope(r2)[0]

    @np.errstate(over="ignore", invalid="ignore")
    def gain_and_slope(self, r2: Floats) -> tuple[Floats, Floats]:
        """:meth:`gain` and its derivative by r², elementwise."""
        polynomial, slope = self._polynomial(r2)
        if not self.kappa:
            return polynomial, slope
        law, law_slope = tangent_law(self.kappa, r2)
        return law * polynomial, law * slope + self.kappa * law_slope * polynomial

    def _polynomial(self, r2: Floats) -> tuple[Floats, Floats]:
        """The polynomial 1 + Σ k r²ⁱ and its derivative by r², by Horner's rule."""
        value: Floats = np.zeros_like(r2)
        slope: Floats = value
        for coefficient in self.k[::-1]:
            slope = slope * r2 + value
            value = value * r2 + coefficient
        return 1.0 + value * r2, slope * r2 + value

    def value(self, d: Floats) -> Floats:
        """R at ``d`` (n, 2): (n, 2)."""
        along = self.gain(d**2 @ self.axes) + 2.0 * (d @ self.decentring)
        return np.asarray(d * along[:, None] + (d**2).sum(axis=1)[:, None] * (self.decentring + self.prism))

    def jacobian(self, d: Floats) -> Floats:
        """∂R/∂d at ``d`` (n, 2): (n, 2, 2)."""
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
        """∂R/∂(log ρ, κ, p, q, k) at ``d`` (2, n): (2, 6 + len(k), n).

        The derivatives by p and q are computed only if ``bent``, and are zero otherwise.
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
        """The radius up to which r · gain(r²) grows, at most the last of the table."""
        with np.errstate(invalid="ignore"):
            falling = np.flatnonzero(~(np.diff(RADIUS_TABLE * self.gain(RADIUS_TABLE**2)) > 0))
        return float(RADIUS_TABLE[falling[0]] if len(falling) else RADIUS_TABLE[-1])

    def inverse(self, m: Floats) -> Floats:
        """The d (n, 2) with R(d) = ``m`` (n, 2) on the branch around zero; nan beyond it."""
        d = self._radial_inverse(m)
        if not (self.decentring.any() or self.prism.any()):
            return d
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(BEND_STEPS):
                error = m - self.value(d)
                if not np.nanmax(np.abs(error), initial=0.0) > BEND_TOLERANCE:
                    break
                d = d + (inverse_2x2(self.jacobian(d)) @ error[:, :, None])[:, :, 0]
            return np.where(np.abs(m - self.value(d)).max(axis=1, keepdims=True) < INVERSE_ERROR, d, np.nan)

    def _radial_inverse(self, m: Floats) -> Floats:
        target = np.sqrt(m**2 @ self.axes)
        last = np.searchsorted(RADIUS_TABLE, self.monotone_until(), side="right")
        radii = RADIUS_TABLE[: max(int(last), 2)]
        reached = radii * self.gain(radii**2)
        r = np.interp(target, reached, radii)
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(NEWTON_STEPS):
                gain, slope = self.gain_and_slope(r**2)
                r = r - (r * gain - target) / (gain + 2.0 * r**2 * slope)
            gain = self.gain(r**2)
            valid = (target <= reached[-1]) & (np.abs(r * gain - target) < INVERSE_ERROR)
            return np.asarray(m * np.where(valid, 1.0 / gain, np.nan)[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The parameters β by name: ``scale`` a, ``shape`` A/a (2, 2), ``centre`` w₀, ``offset`` b, and ``radial`` R."""

    scale: float
    shape: Floats
    centre: Floats
    offset: Floats
    radial: Radial

    @property
    def matrix(self) -> Floats:
        """The matrix A (2, 2)."""
        return self.scale * self.shape

    def matrix_columns(self, m: Floats) -> Floats:
        """∂(A m)/∂(a, s₁, s₂) at ``m`` (2, n): (2, 3, n)."""
        return np.stack([self.shape @ m, self.scale * m * [[1.0], [-1.0]], self.scale * m[::-1]], axis=1)


def _products(matrices: Floats, columns: Floats) -> Floats:
    """``matrices`` (2, 2, n) times ``columns`` (2, p, n): (2, p, n).

    With the points along the last axis this is far faster than a matrix product per point.
    """
    products: Floats = matrices[:, 0, None] * columns[0]
    products += matrices[:, 1, None] * columns[1]
    return products


def _scale(w: Floats, c: Floats, distorting: bool) -> float:
    """The factor from rays ``c`` to image points ``w``, both (n, 2), or from these to rays, by least squares."""
    return float((w * c).sum() / ((c**2).sum() if distorting else (w**2).sum()))


@dataclass(frozen=True, slots=True)
class LensTrend:
    """A lens-like trend on ``chart``, ``distorting`` or undistorting, with ``order`` radial coefficients.

    The flags say which other parameters it has: β (p,) = (a, s₁ s₂ if ``anisotropic``, w₀, b if ``tilted`` and on the
    plane, log ρ if ``elliptic``, κ if ``tangent``, p if ``decentred``, q if ``prismatic``, k₁ … k_n).
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
        """Family, order and letters for the other parameters, as in ``plane-d:2+rt``.

        The letters are s for s₁ and s₂, b, r for ρ, t for κ, p and q.
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
        """Whether there is a radial law; without one a centre and axes of it mean nothing."""
        return self.tangent or self.order > 0

    @property
    def _bent(self) -> bool:
        """Whether it has decentring or a prism."""
        return self.decentred or self.prismatic

    @property
    def _free(self) -> Bools:
        """Mask of the full family's parameters that this trend has."""
        flags = [(True, 1), (self.anisotropic, 2), (True, 2), (self._has_offset, 2), (self.elliptic, 1)]
        flags += [(self.tangent, 1), (self.decentred, 2), (self.prismatic, 2), (True, self.order)]
        return np.repeat(*np.array(flags).T).astype(bool)

    def variants(self) -> Iterator[LensTrend]:
        """This trend and those with fewer of the other parameters, of the same order and law, without duplicates."""
        tilted, elliptic = self._has_offset and self._bends, self.elliptic and self._bends
        general = self.anisotropic, tilted, elliptic, self.decentred, self.prismatic
        for s, b, r, p, q in product(*((True, False) if has else (False,) for has in general)):
            if p or not q:  # nothing real has a prism alone
                yield replace(self, anisotropic=s, tilted=b, elliptic=r, decentred=p, prismatic=q)

    def around(self) -> Search:
        """A search of the trends of the next lower, the same and the next higher order, with any other parameters."""
        highest = MAX_TANGENT_ORDER if self.tangent else MAX_ORDER if self.order else 0
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
        """The same trend with ``order`` radial coefficients."""
        return replace(self, order=order)

    def kept(self, smaller: Trend) -> Bools:
        """Mask (p,) of the β that the ``smaller`` trend has too."""
        assert isinstance(smaller, LensTrend)
        inside = np.append(smaller._free, np.zeros(self.order - smaller.order, dtype=bool))
        return np.asarray(inside[self._free])

    @property
    def level(self) -> bool:
        """False, because the centre is free."""
        return False

    @property
    def inverse_is_iterative(self) -> bool:
        """False: the inverse is the branch around the centre."""
        return False

    @property
    def prior_std(self) -> Floats:
        """Standard deviations (p,) of β: small for anisotropy, decentring and prism, and wide for the rest."""
        general = [MATRIX_STD, *[ANISOTROPY_STD] * 2, *[CENTRE_STD] * 2, *[OFFSET_STD] * 2, LOG_RATIO_STD, TANGENT_STD]
        return np.array(general + [BEND_STD] * 4 + [RADIAL_STD] * self.order)[self._free]

    def parts(self, beta: Floats) -> Parts:
        """``beta`` (p,) by name, with the parameters that this trend lacks at zero."""
        free = self._free
        full = np.zeros(len(free))
        full[free] = beta
        a, s1, s2 = full[:3]
        shape = np.array([[1.0 + s1, s2], [s2, 1.0 - s1]])
        radial = Radial(float(full[7]), float(full[8]), full[13:], full[9:11], full[11:13])
        return Parts(a, shape, full[3:5], full[5:7], radial)

    def start(self, w: Floats, c: Floats) -> Floats:
        """A β (p,) without distortion, the scale by least squares, the centre in the image's middle.

        Where the rays ``c`` do not radiate from there, as in a part of a larger image, the centre is fitted too.
        """
        beta = np.zeros(len(self.prior_std))
        middle_w, middle_c = w.mean(axis=0), c.mean(axis=0)
        spread = w - middle_w
        beta[0] = _scale(w, c, self.distorting)
        if ((w - _scale(w, c, True) * c) ** 2).sum() > OFF_CENTRE_SHARE * (spread**2).sum():
            beta[0] = _scale(spread, c - middle_c, self.distorting)
            first = 3 if self.anisotropic else 1
            beta[first : first + 2] = middle_w - middle_c * (beta[0] if self.distorting else 1.0 / beta[0])
        return beta

    def resembling(self, other: Trend, beta: Floats) -> Floats | None:
        """This trend's β (p,) with the values of ``other`` where it has them; None for another chart or direction."""
        if not isinstance(other, LensTrend) or other.family != self.family:
            return None
        full = np.zeros(max(len(self._free), len(other._free)))
        full[: len(other._free)][other._free] = beta
        return full[: len(self._free)][self._free]

    def image(self, beta: Floats, c: Floats, near: Floats) -> Floats:
        """Image points w (n, 2) of rays ``c`` (n, 2), nan where there is none; ``near`` is not used."""
        p = self.parts(beta)
        if self.distorting:
            return p.radial.value((c - p.offset) @ p.matrix) + p.centre
        return p.radial.inverse((c - p.offset) @ np.linalg.inv(p.matrix)) + p.centre

    def ray(self, beta: Floats, w: Floats) -> Floats:
        """Ray coordinates c (n, 2) of image points ``w`` (n, 2); nan where there is none."""
        p = self.parts(beta)
        if self.distorting:
            return p.radial.inverse(w - p.centre) @ np.linalg.inv(p.matrix) + p.offset
        return p.radial.value(w - p.centre) @ p.matrix + p.offset

    def jacobians(self, beta: Floats, w: Floats, c: Floats) -> tuple[Floats, Floats]:
        """∂w/∂c (n, 2, 2), and ∂w/∂β at fixed c (n, 2, p), where ``w`` and ``c`` (n, 2) correspond."""
        p = self.parts(beta)
        columns = np.empty((2, len(self._free), len(w)))
        if self.distorting:
            e = (c - p.offset).T
            m = p.matrix @ e
            inner = p.radial.jacobian_parts(m)
            by_ray = p.matrix @ inner  # A is symmetric
            columns[:, :3] = _products(inner, p.matrix_columns(e))
            columns[:, 7:] = p.radial.shape_jacobian(m, bent=self._bent)
        else:
            d = (w - p.centre).T
            inner = inverse_of_parts(p.radial.jacobian_parts(d))
            by_ray = np.linalg.inv(p.matrix) @ inner
            columns[:, :3] = -_products(by_ray, p.matrix_columns(p.radial.value(d.T).T))
            columns[:, 7:] = -_products(inner, p.radial.shape_jacobian(d, bent=self._bent))
        columns[:, 3:5], columns[:, 5:7] = np.eye(2)[:, :, None], -by_ray
        return by_ray.transpose(2, 0, 1), columns[:, self._free].transpose(2, 0, 1)

    def folds(self, beta: Floats, points: Floats) -> bool:
        """Whether the radial law turns back, or the rays end, closer to the centre than the farthest of ``points``."""
        p = self.parts(beta)
        if p.scale <= 0 or np.linalg.det(p.shape) <= 0:
            return True
        limit = p.radial.monotone_until()
        reach = limit * p.radial.gain(np.array(limit**2)) if self.distorting else limit
        return bool(np.sqrt((points - p.centre) ** 2 @ p.radial.axes).max() >= reach)


def lens_searches(chart: RayChart, distorting: bool, order: int | None) -> list[Search]:
    """One search for all orders of the polynomial law, and one for each order of the tangent law.

    The tangent law needs one each because it is not linear in κ. A given ``order`` is the only one. A trend without
    any law, which is the same in both directions, is a search of its own: close to it the centre and the axes of a law
    are arbitrary, so it does not follow from a trend that has one.
    """
    general, searches = LensTrend(chart, distorting, MAX_ORDER if order is None else order, tangent=False), []
    if orders := range(1, MAX_ORDER + 1) if order is None else [order] if order else []:
        searches.append(Search(general, tuple(v for n in orders for v in general.of_order(n).variants())))
    if order == 0 or (order is None and not distorting):
        none = replace(general, order=0, tilted=False, elliptic=False)
        searches.append(Search(none, tuple(none.variants())))
    if not distorting and isinstance(chart, Angles):
        return searches  # the angle would be a tangent of the radius, which no lens has
    for n in range(MAX_TANGENT_ORDER + 1) if order is None else [order]:
        tangent = LensTrend(chart, distorting, n)
        searches.append(Search(tangent, tuple(tangent.variants())))
    return searches
