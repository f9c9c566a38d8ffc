"""A lens behind a pane of uneven thickness, such as a windscreen.

A thin prism deflects a ray in proportion to its wedge angle, so a pane deflects rays along the gradient of its
thickness. The deflection is expressed as a shift of the image: pixel uv shows what the lens alone shows at uv + ∇h(uv).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints
from pinholify.simulation.lenses.base import Lens, LensRays
from pinholify.simulation.newton import solve


@dataclass(frozen=True, slots=True)
class Bump:
    """A Gaussian bump of the pane at ``uv`` with standard deviation ``width`` and a largest shift ``shift``, in px."""

    uv: tuple[float, float]
    width: float
    shift: float

    def bend(self, uv: Floats) -> Floats:
        """The image shift (N, 2) at ``uv`` (N, 2)."""
        d, height = self._height(uv)
        return d * height[:, None]

    def slope(self, uv: Floats) -> Floats:
        """The derivative (N, 2, 2) of the shift at ``uv`` (N, 2)."""
        d, height = self._height(uv)
        return (np.eye(2) - d[:, :, None] * d[:, None, :]) * (height / self.width)[:, None, None]

    def _height(self, uv: Floats) -> tuple[Floats, Floats]:
        d = (uv - self.uv) / self.width
        # The maximum of exp(½ - ½d²)·d is 1, at d = 1.
        return d, np.asarray(self.shift * np.exp(0.5 - 0.5 * (d[:, 0] ** 2 + d[:, 1] ** 2)))


@dataclass(frozen=True, slots=True)
class Windscreen:
    """Any ``lens`` behind a pane with ``bumps``."""

    lens: Lens
    bumps: tuple[Bump, ...]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        return self.lens.size

    @property
    def central(self) -> bool:
        """Whether the lens behind the pane is central."""
        return self.lens.central

    def _bend(self, uv: Floats) -> Floats:
        return uv + sum((bump.bend(uv) for bump in self.bumps), np.zeros_like(uv))

    def unproject(self, uv: Floats) -> LensRays:
        """The rays that the pixels ``uv`` (N, 2) see."""
        return self.lens.unproject(self._bend(uv))

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3); NaN where the lens has none."""

        def bend_and_slope(uv: Floats, _: Ints) -> tuple[Floats, Floats]:
            return self._bend(uv), np.eye(2) + sum(bump.slope(uv) for bump in self.bumps)

        through_lens = self.lens.project(points)
        return solve(bend_and_slope, through_lens, through_lens)


def bumpy(lens: Lens, *, count: int, width: float, shift: float, seed: int) -> Windscreen:
    """``lens`` behind ``count`` random bumps with widths of about ``width`` px and shifts of up to ``shift`` px."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, lens.size, (count, 2))
    widths = width * rng.uniform(0.7, 1.4, count)
    shifts = shift * rng.uniform(0.4, 1.0, count) * rng.choice([-1.0, 1.0], count)
    return Windscreen(lens, tuple(
        Bump((float(u), float(v)), float(w), float(s))
        for (u, v), w, s in zip(places, widths, shifts, strict=True)
    ))
