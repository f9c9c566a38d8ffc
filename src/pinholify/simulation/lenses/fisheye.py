"""The Kannala-Brandt fisheye, whose field of view may exceed 180°.

Source: Kannala & Brandt, *A generic camera model and calibration method* (2006), radially symmetric part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from pinholify.arrays import Floats, Ints
from pinholify.simulation.lenses.base import LensRays, central_rays, image_centre
from pinholify.simulation.newton import smallest_positive, solve


@dataclass(frozen=True, slots=True)
class Fisheye:
    """``radius = focal · θ(1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)`` px at the angle θ from the axis.

    ``offset`` is that of the principal point from the image's centre, px.
    """

    size: tuple[int, int]
    focal: float
    k: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    offset: tuple[float, float] = (0.0, 0.0)
    central = True

    @property
    def _radius(self) -> Polynomial:
        return Polynomial([0, 1, 0, self.k[0], 0, self.k[1], 0, self.k[2], 0, self.k[3]])

    @property
    def _angle_limit(self) -> float:
        """θ at which the radius stops growing, π at most."""
        return min(smallest_positive(self._radius.deriv().trim().roots().tolist(), np.pi), np.pi)

    def _angles(self, radius: Floats) -> Floats:
        polynomial, slope = self._radius, self._radius.deriv()

        def equations(theta: Floats, _: Ints) -> tuple[Floats, Floats]:
            return polynomial(theta), slope(theta)[:, None]

        limit = self._angle_limit
        theta = solve(equations, radius, np.minimum(radius, 0.9 * limit))
        theta[theta > limit] = np.nan
        return theta

    def unproject(self, uv: Floats) -> LensRays:
        """The rays that the pixels ``uv`` (N, 2) see; NaN outside the image circle."""
        d = (uv - image_centre(self.size) - self.offset) / self.focal
        radius = np.linalg.norm(d, axis=1, keepdims=True)
        theta = self._angles(radius)
        sideways = d * np.sin(theta) / np.maximum(radius, 1e-300)
        return central_rays(np.concatenate([sideways, np.cos(theta)], axis=1))

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3), also behind the camera; NaN beyond the angle of the largest radius."""
        rho = np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        theta = np.arctan2(rho, points[:, 2:])
        theta = np.where(theta <= self._angle_limit, theta, np.nan)
        uv = self.focal * self._radius(theta) * points[:, :2] / np.maximum(rho, 1e-300)
        return np.asarray(uv + image_centre(self.size) + self.offset)
