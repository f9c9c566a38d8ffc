"""A camera that looks through a flat pane of glass into water: refracted rays without a single centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints
from pinholify.simulation.lenses.base import Lens, LensRays, require_central
from pinholify.simulation.newton import solve


def refract(directions: Floats, normal: Floats, index_ratio: float) -> Floats:
    """Unit ``directions`` (N, 3) after refraction at a surface with unit ``normal`` (3,), by Snell's law.

    ``index_ratio`` is the refractive index in front of the surface ÷ that behind it; NaN for total reflection.
    """
    tangential = index_ratio * (directions - (directions @ normal)[:, None] * normal)
    with np.errstate(invalid="ignore"):
        along = np.sqrt(1 - (tangential**2).sum(axis=1, keepdims=True))
    return np.asarray(tangential + along * normal)


@dataclass(frozen=True, slots=True)
class WaterPane:
    """A central ``lens`` in air, ``distance`` in front of a pane of ``thickness`` with water behind it; in squares.

    ``normal`` is that of the pane in the camera frame, pointing away from the camera; it need not be of unit length.
    Raises ValueError for a lens without a single centre.
    """

    lens: Lens
    distance: float
    thickness: float
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    glass_index: float = 1.5
    water_index: float = 1.333
    central = False

    def __post_init__(self) -> None:
        """Refuse lenses that cannot be traced."""
        require_central(self.lens, "a water pane")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        return self.lens.size

    @property
    def _normal(self) -> Floats:
        return np.asarray(np.array(self.normal) / np.linalg.norm(self.normal))

    def unproject(self, uv: Floats) -> LensRays:
        """The rays in water of the pixels ``uv`` (N, 2), from the pane's outer face; NaN where they miss the pane."""
        normal = self._normal
        in_air = self.lens.unproject(uv).directions
        cosine = (in_air @ normal)[:, None]
        in_air = np.where(cosine > 0, in_air, np.nan)
        in_glass = refract(in_air, normal, 1 / self.glass_index)
        in_water = refract(in_glass, normal, self.glass_index / self.water_index)
        outer = in_air * self.distance / cosine + in_glass * self.thickness / (in_glass @ normal)[:, None]
        return LensRays(outer, in_water)

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3) in the water; NaN for points that are not behind the pane."""
        normal = self._normal
        height = points @ normal
        lateral = points - height[:, None] * normal
        rho = np.linalg.norm(lateral, axis=1, keepdims=True)
        depth = (height - self.distance - self.thickness)[:, None]
        depth = np.where(depth >= 0, depth, np.nan)
        tangent = self._tangent_in_air(rho, depth)
        return self.lens.project(normal + lateral * tangent / np.maximum(rho, 1e-300))

    def _tangent_in_air(self, rho: Floats, depth: Floats) -> Floats:
        """Tangent (N, 1) of the angle in air to the normal at which a ray is ``rho`` off the normal at ``depth``.

        By Snell's law a ray of tangent t in air has t/√(n² + (n² - 1) t²) in a medium of index n.
        """

        layers = ((np.full_like(depth, self.distance), 1.0),
                  (np.full_like(depth, self.thickness), self.glass_index), (depth, self.water_index))

        def equations(t: Floats, rows: Ints) -> tuple[Floats, Floats]:
            reach, slope = np.zeros_like(t), np.zeros_like(t)
            for lengths, index in layers:
                length = lengths[rows]
                root = np.sqrt(index**2 + (index**2 - 1) * t**2)
                reach = reach + length * t / root
                slope = slope + length * index**2 / root**3
            return reach, slope[:, None]

        target = np.where(np.isfinite(depth), rho, np.nan)
        return solve(equations, target, rho / (self.distance + self.thickness + np.nan_to_num(depth)))
