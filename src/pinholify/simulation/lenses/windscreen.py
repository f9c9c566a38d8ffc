"""A lens behind a pane of uneven thickness, such as a windscreen.

A thin prism turns a ray in proportion to its wedge, so a pane bends rays along the gradient of its thickness.
The bend is expressed as a shift of the image: pixel uv shows what the lens alone shows at uv + ∇h(uv).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints
from pinholify.simulation.lenses.base import Lens, Rays
from pinholify.simulation.newton import solve


@dataclass(frozen=True, slots=True)
class Bump:
    """A Gaussian swelling of the pane at ``uv``, ``width`` wide, that shifts by up to ``shift``; in px."""

    uv: tuple[float, float]
    width: float
    shift: float

    def bend(self, uv: Floats) -> tuple[Floats, Floats]:
        """The image shift (N, 2) at ``uv`` (N, 2) and its derivative (N, 2, 2)."""
        d = (uv - self.uv) / self.width
        # exp(½ - ½d²)·d is largest at d = 1, where it is 1.
        h = self.shift * np.exp(0.5 - 0.5 * (d**2).sum(axis=1))
        hessian = (np.eye(2) - d[:, :, None] * d[:, None, :]) * (h / self.width)[:, None, None]
        return d * h[:, None], hessian


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
        """Whether the lens behind the pane is."""
        return self.lens.central

    def _bend(self, uv: Floats, _: Ints) -> tuple[Floats, Floats]:
        shifted, jacobian = uv.copy(), np.tile(np.eye(2), (len(uv), 1, 1))
        for bump in self.bumps:
            shift, slope = bump.bend(uv)
            shifted += shift
            jacobian += slope
        return shifted, jacobian

    def unproject(self, uv: Floats) -> Rays:
        """The rays that the pixels ``uv`` (N, 2) see."""
        shifted = uv.copy()
        for bump in self.bumps:
            shifted += bump.bend(uv)[0]
        return self.lens.unproject(shifted)

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3); NaN where the lens has none."""
        through_lens = self.lens.project(points)
        return solve(self._bend, through_lens, through_lens)


def bumpy(lens: Lens, *, count: int, width: float, shift: float, seed: int) -> Windscreen:
    """``lens`` behind ``count`` random bumps, each about ``width`` px wide and of up to ``shift`` px."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, lens.size, (count, 2))
    widths = width * rng.uniform(0.7, 1.4, count)
    shifts = shift * rng.uniform(0.4, 1.0, count) * rng.choice([-1.0, 1.0], count)
    return Windscreen(lens, tuple(
        Bump((float(u), float(v)), float(w), float(s))
        for (u, v), w, s in zip(places, widths, shifts, strict=True)
    ))
