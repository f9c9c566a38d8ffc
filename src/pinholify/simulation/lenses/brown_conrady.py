"""Brown-Conrady distortion with OpenCV's rational, thin-prism and tilt terms.

Source: Brown, *Decentering distortion of lenses* (1966); the fourteen parameters of OpenCV's camera model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from scipy.spatial.transform import Rotation

from pinholify.arrays import Floats, Ints
from pinholify.geometry import apply_homography
from pinholify.simulation.lenses.base import LensRays, central_rays, image_centre
from pinholify.simulation.newton import smallest_positive, solve


@dataclass(frozen=True, slots=True)
class BrownConrady:
    """OpenCV's model with ``focal`` (x, y) and the ``offset`` of the principal point from the image's centre, in px.

    The other parameters are OpenCV's: ``radial`` k1, k2, k3; ``denominator`` k4, k5, k6; ``tangential`` p1, p2;
    ``thin_prism`` s1 … s4; ``tilt`` of the sensor τx, τy in radians.
    """

    size: tuple[int, int]
    focal: tuple[float, float]
    offset: tuple[float, float] = (0.0, 0.0)
    radial: tuple[float, float, float] = (0.0, 0.0, 0.0)
    denominator: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tangential: tuple[float, float] = (0.0, 0.0)
    thin_prism: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)
    central = True

    @property
    def _radius_squared_limit(self) -> float:
        """r² at which the distorted radius stops growing: beyond it the model folds the image over."""
        n, d, s = Polynomial([1, *self.radial]), Polynomial([1, *self.denominator]), Polynomial([0, 1])
        slope = n * d + 2 * s * (n.deriv() * d - n * d.deriv())
        roots = np.concatenate([slope.trim().roots(), d.trim().roots()])
        return smallest_positive(roots.tolist(), np.inf)

    @property
    def _sensor(self) -> Floats:
        """The homography (3, 3) from the distorted plane z = 1 to px."""
        tilt = Rotation.from_euler("xy", [-self.tilt[0], -self.tilt[1]]).as_matrix()
        onto_sensor = np.array([[tilt[2, 2], 0, -tilt[0, 2]], [0, tilt[2, 2], -tilt[1, 2]], [0, 0, 1]]) @ tilt
        u, v = image_centre(self.size) + self.offset
        return np.asarray(np.array([[self.focal[0], 0, u], [0, self.focal[1], v], [0, 0, 1]]) @ onto_sensor)

    def _distort(self, xy: Floats, _: Ints) -> tuple[Floats, Floats]:
        """Distorted points (N, 2) of the plane z = 1 and their derivatives (N, 2, 2)."""
        x, y = xy.T
        s = x**2 + y**2
        numerator, denominator = Polynomial([1, *self.radial]), Polynomial([1, *self.denominator])
        n, d = numerator(s), denominator(s)
        g, slope = n / d, (numerator.deriv()(s) * d - n * denominator.deriv()(s)) / d**2
        (p1, p2), (s1, s2, s3, s4) = self.tangential, self.thin_prism
        value = np.stack([x * g + 2 * p1 * x * y + p2 * (s + 2 * x**2) + (s1 + s2 * s) * s,
                          y * g + p1 * (s + 2 * y**2) + 2 * p2 * x * y + (s3 + s4 * s) * s], axis=1)
        cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        prism_x, prism_y = 2 * (s1 + 2 * s2 * s), 2 * (s3 + 2 * s4 * s)
        du = [g + 2 * x**2 * slope + 2 * p1 * y + 6 * p2 * x + prism_x * x, cross + prism_x * y]
        dv = [cross + prism_y * x, g + 2 * y**2 * slope + 6 * p1 * y + 2 * p2 * x + prism_y * y]
        return value, np.stack([np.stack(du, axis=1), np.stack(dv, axis=1)], axis=1)

    def unproject(self, uv: Floats) -> LensRays:
        """The rays that the pixels ``uv`` (N, 2) see; NaN beyond the largest distorted radius."""
        distorted = apply_homography(np.asarray(np.linalg.inv(self._sensor)), uv)
        limit = self._radius_squared_limit
        r = np.maximum(np.linalg.norm(distorted, axis=1, keepdims=True), 1e-300)
        xy = solve(self._distort, distorted, distorted * np.minimum(1, 0.9 * np.sqrt(limit) / r))
        xy[(xy**2).sum(axis=1) > limit] = np.nan
        return central_rays(np.concatenate([xy, np.ones((len(xy), 1))], axis=1))

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3); NaN behind the camera and where the model folds over."""
        xy = points[:, :2] / np.where(points[:, 2:] > 0, points[:, 2:], np.nan)
        xy = np.where((xy**2).sum(axis=1, keepdims=True) <= self._radius_squared_limit, xy, np.nan)
        return apply_homography(self._sensor, self._distort(xy, np.arange(len(xy)))[0])
