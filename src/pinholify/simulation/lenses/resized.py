"""A lens with larger or smaller pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.simulation.lenses.base import Lens, LensRays


@dataclass(frozen=True, slots=True)
class Resized:
    """``lens`` with its whole image scaled to ``size``; the image's edges, not the pixel centres, stay in place."""

    lens: Lens
    size: tuple[int, int]

    @property
    def central(self) -> bool:
        """Whether the lens is central."""
        return self.lens.central

    @property
    def _scale(self) -> Floats:
        return np.asarray(np.array(self.size, dtype=np.float64) / np.array(self.lens.size))

    def unproject(self, uv: Floats) -> LensRays:
        """The rays that the pixels ``uv`` (N, 2) see."""
        return self.lens.unproject((uv + 0.5) / self._scale - 0.5)

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3); NaN where the lens has none."""
        return np.asarray((self.lens.project(points) + 0.5) * self._scale - 0.5)
