"""Filled contours of a function over the image, as polygons."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Floats, frozen
from pinholify.geometry import ConvexRegion

NODES = (65, 49)  # columns, rows of the grid on which functions are evaluated
FINE = 480  # columns of the grid on which contours are traced
TOLERANCE = 0.9  # fine pixels

Polygons = tuple[Floats, ...]
"""Closed outlines (n, 2) px, holes included: fill by the even-odd rule."""


def grid_pixels(image_size: tuple[int, int]) -> Floats:
    """The grid's nodes (n, 2) px over the whole image, from border to border, row by row."""
    u, v = (np.linspace(0.0, extent - 1.0, count) for extent, count in zip(image_size, NODES, strict=True))
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def regions_above(values: Floats, levels: Sequence[float], image_size: tuple[int, int]) -> tuple[Polygons, ...]:
    """For each of ``levels``, where the function with ``values`` (n,) at :func:`grid_pixels` is at least that."""
    fine = _upsampled(values, image_size)
    return tuple(_outlines(fine >= level, image_size) for level in levels)


def region_inside(hull: ConvexRegion, values: Floats, limit: float, image_size: tuple[int, int]) -> Polygons:
    """Where in ``hull`` the function with ``values`` (n,) at :func:`grid_pixels` is at most ``limit``."""
    rows, columns = _upsampled(values, image_size).shape
    u, v = np.linspace(0.0, image_size[0] - 1.0, columns), np.linspace(0.0, image_size[1] - 1.0, rows)
    within = hull.contains(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)).reshape(rows, columns)
    return _outlines(within & (_upsampled(values, image_size) <= limit), image_size)


def _upsampled(values: Floats, image_size: tuple[int, int]) -> NDArray[np.float32]:
    """The function interpolated on the fine grid, from border to border."""
    rows = max(2, round(FINE * image_size[1] / image_size[0]))
    x, y = np.linspace(0, NODES[0] - 1, FINE, dtype=np.float32), np.linspace(0, NODES[1] - 1, rows, dtype=np.float32)
    grid = values.reshape(NODES[1], NODES[0]).astype(np.float32)
    return np.asarray(cv2.remap(grid, *np.meshgrid(x, y), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def _outlines(mask: Bools, image_size: tuple[int, int]) -> Polygons:
    scale = (np.array(image_size) - 1.0) / (mask.shape[1] - 1.0, mask.shape[0] - 1.0)
    found = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)[0]
    simple = (cv2.approxPolyDP(line, TOLERANCE, closed=True)[:, 0] for line in found)
    return tuple(frozen(line * scale, (None, 2)) for line in simple if len(line) > 2)
