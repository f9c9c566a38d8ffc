"""A screen in front of a lens: the captures of each picture that the screen shows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import frozen
from pinholify.geometry import Pose
from pinholify.simulation.lenses import Lens
from pinholify.simulation.photograph import Sensor, photograph
from pinholify.simulation.rendering import CHUNK_RAYS, PixelRays, golden_lattice, pixel_rays
from pinholify.simulation.scene import TexturedPlane


@dataclass(frozen=True, slots=True, eq=False)
class ScreenView:
    """The screen pixels that several rays per camera pixel meet: ``pixels`` (samples, h, w) int32.

    Screen pixels are numbered row by row; −1 is a ray that misses the screen.
    """

    pixels: NDArray[np.int32]

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", frozen(self.pixels, (None, None, None), np.int32))

    def of(self, picture: NDArray[np.uint8], *, gamma: float = 2.2, ambient: float = 0.05) -> NDArray[np.float32]:
        """The light (h, w), 0 … 1, that the camera receives from the screen's ``picture`` (height, width) uint8.

        A pixel of the screen is a square of uniform brightness, its level to the power of ``gamma``; ``ambient`` light
        is added everywhere, and is the only light outside the screen.
        """
        light = np.append((picture.ravel() / np.float32(255.0)) ** np.float32(gamma), np.float32(0.0))
        total = np.zeros(self.pixels.shape[1:], np.float32)
        for pixels in self.pixels:
            total += light[pixels]
        return np.asarray(ambient + (0.95 - ambient) * total / len(self.pixels), dtype=np.float32)


def view_screen(
    rays: PixelRays, pose: Pose, size: tuple[int, int], *, spacing: int, samples: int = 13
) -> ScreenView:
    """The screen of ``size`` (width, height) px at ``pose``, seen by ``rays`` with ``samples`` (a prime) per pixel.

    The unit of length is ``spacing`` screen pixels, and the plane's origin is half of that from the screen's top left
    corner: the nodes of ``board.Screen`` are then the points of the integer lattice.
    """
    width, height = rays.size
    found = np.empty((samples, width * height), np.int32)
    screen = TexturedPlane(pose, lambda xy: xy)
    for start in range(0, width * height, CHUNK_RAYS):
        pixels = np.arange(start, min(start + CHUNK_RAYS, width * height))
        for i, shifted in enumerate(rays.around(pixels, golden_lattice(samples) - 0.5)):
            distance, xy = screen.intersect(shifted)
            with np.errstate(invalid="ignore"):
                column, row = np.floor((np.where(np.isfinite(distance)[:, None], xy, -1.0) + 0.5) * spacing).T
                met = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
            found[i, pixels] = np.where(met, np.where(met, row, 0) * size[0] + np.where(met, column, 0), -1)
    return ScreenView(found.reshape(samples, height, width))


def capture_screen(
    lens: Lens,
    pose: Pose,
    pictures: Iterable[NDArray[np.uint8]],
    sensor: Sensor,
    *,
    spacing: int,
    samples: int = 13,
    seed: int = 0,
) -> Iterator[NDArray[np.uint8]]:
    """The captures by ``lens`` and ``sensor`` of each of the ``pictures`` (height, width) on a screen at ``pose``.

    ``pose`` is camera_from_screen as in :func:`view_screen`; each capture has its own noise, from ``seed``.
    """
    view: ScreenView | None = None
    for i, picture in enumerate(pictures):
        if view is None:
            size = (picture.shape[1], picture.shape[0])
            view = view_screen(pixel_rays(lens), pose, size, spacing=spacing, samples=samples)
        yield photograph(view.of(picture), sensor, (seed, i))
