"""The paper's straightening: every pixel moves to its rounded new position, medians of neighbours fill the holes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Ints
from pinholify.camera import VirtualCamera
from pinholify.expansion import expand
from pinholify.rectification.maps import Image, rectification_map
from pinholify.rectification.valid_region import source_mask
from pinholify.rectification.views import View

AROUND = np.array(list(product((-1, 0, 1), repeat=2)))
CHUNK = 1 << 16  # pixels filled at a time: few enough for the processor's cache


@dataclass(frozen=True, slots=True, eq=False)
class Splatter:
    """Converts images to a view of ``size`` (width, height) px.

    The flat positions ``places`` (n,) of the view receive the flat pixels ``sources`` (n,) of the image. ``holes`` are
    filled in order, each from the pixels filled before: positions (k,), and which of the nine around each are filled
    (k, 9).
    """

    size: tuple[int, int]
    places: Ints
    sources: Ints
    holes: tuple[tuple[Ints, Bools], ...]

    def __call__(self, image: Image) -> Image:
        """The view (height, width[, c]) of ``image`` (h, w[, c]) of any dtype; black where it is not valid."""
        width, height = self.size
        channels = image.shape[2:]
        out = np.zeros((width * height, *channels), dtype=image.dtype)
        out[self.places] = image.reshape(-1, *channels)[self.sources]
        offsets = AROUND @ np.array([width, 1])
        for places, filled in self.holes:
            whole = [slice(start, start + CHUNK) for start in range(0, len(places), CHUNK)]
            medians = [_medians(out, places[part, None] + offsets, filled[part]) for part in whole]
            out[places] = np.concatenate(medians)
        return out.reshape(height, width, *channels)


def splatter(camera: VirtualCamera, view: View, *, max_std: float | None = None) -> Splatter:
    """The :class:`Splatter` from images of ``camera`` to ``view``; ``max_std`` as in :func:`source_mask`."""
    width, height = view.size
    to_view = expand(
        lambda uv: view.project(camera.chart.directions(camera.plane_map.value(uv))), camera.image_size, tolerance=0.05
    )
    with np.errstate(invalid="ignore"):
        column, row = np.rint(to_view, out=to_view)
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height) & source_mask(camera, max_std)
    pixels = np.flatnonzero(inside)
    source = np.full(width * height, -1, dtype=np.int64)
    source[row[inside].astype(np.int64) * width + column[inside].astype(np.int64)] = pixels
    places = np.flatnonzero(source >= 0)
    filled = (source >= 0).reshape(height, width)
    wanted = filled | rectification_map(camera, view, max_std=max_std).valid
    return Splatter(view.size, places, source[places], _holes(filled, wanted))


def _holes(filled: Bools, wanted: Bools) -> tuple[tuple[Ints, Bools], ...]:
    """The pixels ``wanted`` but not ``filled``, in the order in which they can be filled.

    Where the view magnifies, pixels are far apart, and all grow at the same rate until they meet.
    """
    rounds: list[tuple[Ints, Bools]] = []
    while True:
        reached = cv2.dilate(filled.view(np.uint8), np.ones((3, 3), np.uint8)).view(np.bool_)
        holes = wanted & ~filled & reached
        if not holes.any():
            return tuple(rounds)
        row, column = np.nonzero(holes)
        padded = np.pad(filled, 1)
        around = np.stack([padded[row + 1 + down, column + 1 + right] for down, right in AROUND], axis=1)
        rounds.append((np.flatnonzero(holes), around))
        filled = filled | holes


def _medians(values: NDArray[Any], around: Ints, filled: Bools) -> NDArray[Any]:
    """Medians (k[, c]) over the ``filled`` (k, 9) of the flat positions ``around`` (k, 9) in ``values`` (n[, c])."""
    dtype = values.dtype
    last = np.inf if np.issubdtype(dtype, np.floating) else np.iinfo(dtype).max  # is sorted to the end
    found = values.take(around, axis=0, mode="clip")
    found[~filled] = last
    found.sort(axis=1)
    count, each = filled.sum(axis=1), np.arange(len(filled))
    low, high = found[each, (count - 1) // 2], found[each, count // 2]
    return np.asarray(((low.astype(np.float64) + high) / 2.0).astype(dtype))
