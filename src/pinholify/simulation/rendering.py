"""Backward ray tracing: what each pixel of a lens sees of a scene, averaged over the pixel's area."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from pinholify.arrays import Floats, Ints
from pinholify.simulation.lenses import Lens, Rays
from pinholify.simulation.scene import Scene

CHUNK = 100_000
"""Rays traced at a time: enough to keep NumPy busy, few enough to stay in the cache."""

EDGE = 0.01
"""Contrast (white = 1) to a neighbour from which on a pixel is worth more than one ray."""


@dataclass(frozen=True, slots=True, eq=False)
class PixelRays:
    """The rays of all pixels of a lens, (h·w, 3) float32 each: unprojected once for many scenes.

    float32 keeps directions to 6e-8 rad, some 1e-4 px.
    """

    size: tuple[int, int]
    origins: NDArray[np.float32]
    directions: NDArray[np.float32]

    def at(self, pixels: Ints) -> Rays:
        """The rays through the centres of ``pixels`` (n,), numbered along rows."""
        return Rays(self.origins[pixels].astype(np.float64), self.directions[pixels].astype(np.float64))

    def around(self, pixels: Ints, offsets: Floats) -> Iterator[Rays]:
        """For each of ``offsets`` (m, 2) px: the rays that pass so far from the centres of ``pixels`` (n,).

        First order in the offset: right to 1e-3 px, or a few 1e-2 px where rays graze the rim of a mirror.
        """
        centre = self.at(pixels)
        along_u, along_v = self._slope(pixels, 0), self._slope(pixels, 1)
        for u, v in offsets:
            yield Rays(*(c + u * du + v * dv for c, du, dv in zip(centre, along_u, along_v, strict=True)))

    def _slope(self, pixels: Ints, axis: int) -> Rays:
        """Change of the rays per px along u (axis 0) or v (axis 1), by differences to both neighbours."""
        width, height = self.size
        place = pixels % width if axis == 0 else pixels // width
        back, forth = place > 0, place < (width, height)[axis] - 1
        stride = (1, width)[axis]
        before, after = self.at(pixels - stride * back), self.at(pixels + stride * forth)
        steps = (back.astype(np.float64) + forth)[:, None]
        return Rays(*((b - a) / steps for a, b in zip(before, after, strict=True)))


def pixel_rays(lens: Lens) -> PixelRays:
    """The rays of all pixels of ``lens``."""
    width, height = lens.size
    directions = np.empty((width * height, 3), np.float32)
    centre = np.zeros(3, np.float32)
    origins = np.broadcast_to(centre, directions.shape) if lens.central else np.empty_like(directions)
    for pixels in _chunks(np.arange(width * height)):
        rays = lens.unproject(np.stack([pixels % width, pixels // width], axis=1).astype(np.float64))
        directions[pixels] = rays.directions
        if not lens.central:
            origins[pixels] = rays.origins
    return PixelRays(lens.size, origins, directions)


def render(rays: PixelRays, scene: Scene, *, samples: int = 53) -> NDArray[np.float32]:
    """The picture (h, w) of a grey ``scene``, or (h, w, channels), 0 black … 1 white, without blur or noise.

    One ray a pixel, and ``samples`` rays (a prime number) spread over its area where it differs from a
    neighbour. Detail finer than a pixel is averaged too unless it repeats in step with the pixels.
    """
    width, height = rays.size
    parts = [scene.trace(rays.at(pixels)).astype(np.float32) for pixels in _chunks(np.arange(width * height))]
    image = np.concatenate(parts)
    offsets = golden_lattice(samples) - 0.5
    for pixels in _chunks(_edges(image.reshape(height, width, -1))):
        total = sum(scene.trace(shifted) for shifted in rays.around(pixels, offsets))
        image[pixels] = total / samples
    return image.reshape(height, width, -1).squeeze()


def golden_lattice(count: int) -> Floats:
    """``count`` points (count, 2) spread evenly over the unit square: a rank-1 lattice by the golden ratio.

    For a prime ``count`` no direction of small integers has two points at one place, so the share of the
    points on one side of an edge is right to about 1/count however the edge runs.
    """
    i = np.arange(count)
    generator = round(count * (np.sqrt(5) - 1) / 2)
    return np.stack([(i + 0.5) / count, (i * generator % count + 0.5) / count], axis=1)


def _edges(image: NDArray[np.float32]) -> Ints:
    """Numbers (n,) of the pixels of ``image`` (h, w, channels) that differ from one of their neighbours."""
    contrast = maximum_filter(image, (3, 3, 1)) - minimum_filter(image, (3, 3, 1))
    return np.flatnonzero((contrast > EDGE).any(axis=2))


def _chunks(pixels: Ints) -> Iterator[Ints]:
    return (pixels[i : i + CHUNK] for i in range(0, len(pixels), CHUNK))
