"""Backward ray tracing: what each pixel of a lens sees of a scene, averaged over the area of the pixel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from pinholify.arrays import Floats, Ints
from pinholify.simulation.lenses import Lens, LensRays
from pinholify.simulation.scene import Scene

CHUNK_RAYS = 100_000
"""Rays traced at a time: enough to keep NumPy busy, few enough to stay in the cache."""

EDGE_CONTRAST = 0.01
"""Contrast (white = 1) to a neighbour above which more than one ray is traced per pixel."""


@dataclass(frozen=True, slots=True, eq=False)
class PixelRays:
    """The rays of all pixels of a lens, unprojected once for many scenes.

    ``origins`` (h·w, 3) and unit ``directions`` (h·w, 3) are float32: an error of 6e-8 rad, about 1e-4 px.
    """

    size: tuple[int, int]
    origins: NDArray[np.float32]
    directions: NDArray[np.float32]

    def at(self, pixels: Ints) -> LensRays:
        """The rays through the centres of ``pixels`` (n,), numbered row by row."""
        return LensRays(self.origins[pixels].astype(np.float64), self.directions[pixels].astype(np.float64))

    def around(self, pixels: Ints, offsets: Floats) -> Iterator[LensRays]:
        """For each of ``offsets`` (m, 2) px, the rays at that offset from the centres of ``pixels`` (n,).

        First order in the offset: the error is 1e-3 px, or a few 1e-2 px where rays graze the rim of a mirror.
        """
        centre = self.at(pixels)
        along_u, along_v = self._slope(pixels, 0), self._slope(pixels, 1)
        for u, v in offsets:
            yield LensRays(*(c + u * du + v * dv for c, du, dv in zip(centre, along_u, along_v, strict=True)))

    def _slope(self, pixels: Ints, axis: int) -> LensRays:
        """Change of the rays per px along u (``axis`` 0) or v (1), by differences between both neighbours."""
        width, height = self.size
        place = pixels % width if axis == 0 else pixels // width
        back, forth = place > 0, place < (width, height)[axis] - 1
        stride = (1, width)[axis]
        before, after = self.at(pixels - stride * back), self.at(pixels + stride * forth)
        steps = (back.astype(np.float64) + forth)[:, None]
        return LensRays(*((b - a) / steps for a, b in zip(before, after, strict=True)))


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
    """The image (h, w) of a grey ``scene``, or (h, w, channels), 0 black … 1 white, without blur or noise.

    One ray per pixel, or ``samples`` rays (a prime number) spread over its area if it differs from a neighbour. Detail
    finer than a pixel is averaged too, unless it repeats in step with the pixels.
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

    For a prime ``count`` no two points coincide when projected along a direction of small integers, so the share of the
    points on one side of an edge has an error of about 1/count whatever the edge's direction.
    """
    i = np.arange(count)
    generator = round(count * (np.sqrt(5) - 1) / 2)
    return np.stack([(i + 0.5) / count, (i * generator % count + 0.5) / count], axis=1)


def _edges(image: NDArray[np.float32]) -> Ints:
    """Numbers (n,) of the pixels of ``image`` (h, w, channels) that differ from one of their neighbours."""
    contrast = maximum_filter(image, (3, 3, 1)) - minimum_filter(image, (3, 3, 1))
    return np.flatnonzero((contrast > EDGE_CONTRAST).any(axis=2))


def _chunks(pixels: Ints) -> Iterator[Ints]:
    return (pixels[i : i + CHUNK_RAYS] for i in range(0, len(pixels), CHUNK_RAYS))
