"""The perfect pinhole camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.simulation.lenses.base import LensRays, central_rays, image_centre


@dataclass(frozen=True, slots=True)
class Pinhole:
    """``uv = focal · (x/z, y/z) + image centre + offset``; ``focal`` and ``offset`` in px."""

    size: tuple[int, int]
    focal: float
    offset: tuple[float, float] = (0.0, 0.0)
    central = True

    def unproject(self, uv: Floats) -> LensRays:
        """The rays that the pixels ``uv`` (N, 2) see."""
        plane = (uv - image_centre(self.size) - self.offset) / self.focal
        return central_rays(np.concatenate([plane, np.ones((len(uv), 1))], axis=1))

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3); NaN for points that are not in front of the camera."""
        depth = np.where(points[:, 2:] > 0, points[:, 2:], np.nan)
        return np.asarray(self.focal * points[:, :2] / depth + image_centre(self.size) + self.offset)
