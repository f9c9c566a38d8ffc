"""A pinhole camera seen through the lens effect of the Unity engine's post-processing stack.

The effect is radial in image coordinates divided by width *and* height, so circles become ellipses in px: no lens model
that is radial in px fits it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.simulation.lenses.base import LensRays
from pinholify.simulation.lenses.pinhole import Pinhole


@dataclass(frozen=True, slots=True)
class Unity:
    """The lens effect of ``intensity`` (-100 … 100; above zero barrel, below pincushion) around ``centre``.

    ``centre`` is the offset from the image's centre in units of width and height. With q = (p + ½)/(W, H) - ½ - centre
    and r = ‖q‖, the pixel at r shows the pinhole image's point at tan(θ r)/σ (barrel) or atan(σ r)/θ (pincushion),
    where θ = min(160°, 1.6°·max(1, abs(intensity))) and σ = 2 tan(θ/2).
    """

    size: tuple[int, int]
    focal: float
    intensity: float
    centre: tuple[float, float] = (0.0, 0.0)
    central = True

    @property
    def _theta(self) -> float:
        return float(np.deg2rad(min(160.0, 1.6 * max(abs(self.intensity), 1.0))))

    def _stretch(self, r: Floats) -> Floats:
        # tan(θ r)/σ, NaN from 90° on
        angle = self._theta * r
        return np.asarray(np.where(angle < np.pi / 2, np.tan(angle), np.nan) / (2 * np.tan(self._theta / 2)))

    def _compress(self, r: Floats) -> Floats:
        return np.asarray(np.arctan(2 * np.tan(self._theta / 2) * r) / self._theta)

    def _move(self, uv: Floats, *, stretch: bool) -> Floats:
        wh = np.array(self.size, dtype=np.float64)
        middle = 0.5 + np.array(self.centre)
        q = (uv + 0.5) / wh - middle
        r = np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-300)
        moved = self._stretch(r) if stretch else self._compress(r)
        return np.asarray((q * (moved / r) + middle) * wh - 0.5)

    def unproject(self, uv: Floats) -> LensRays:
        """The rays that the pixels ``uv`` (N, 2) see."""
        return Pinhole(self.size, self.focal).unproject(self._move(uv, stretch=self.intensity > 0))

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3); NaN behind the camera or where θ r reaches 90°."""
        return self._move(Pinhole(self.size, self.focal).project(points), stretch=self.intensity <= 0)
