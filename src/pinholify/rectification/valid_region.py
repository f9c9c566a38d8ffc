"""Which pixels of the original image are valid, by the standard deviation of the map, computed once per camera.

One mask decides what is shown, what views are fitted to, and what exports state: :func:`source_mask`. The hull of a
camera's domain, where boards were seen, decides which corners count in measures; it is no limit where a standard
deviation is known.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Floats, frozen
from pinholify.camera import VirtualCamera
from pinholify.expansion import expand

SAMPLES = 400  # along the longer side of the image, of the grid on which the extent of the valid region is determined
DIRECTION_TOLERANCE = 1e-4  # in coordinates of the chart, about radians
LATTICE = 64  # points along the longer side of the image: a standard deviation changes slowly
STD_TOLERANCE = 0.1  # relative bound on what higher orders might add; the true error is a few per mille
MIN_STD_PX = 1e-12  # keeps the logarithm finite


def source_mask(camera: VirtualCamera, max_std: float | None) -> Bools:
    """Mask (height, width) of the valid pixels of the original image, those that are shown.

    Valid are those with a standard deviation of at most ``max_std`` px, by default the domain's limit; where that is
    infinite, those inside the domain's hull.
    """
    width, height = camera.image_size
    limit = camera.domain.max_std if max_std is None else max_std
    if np.isfinite(limit):
        log_limit = np.log(limit + MIN_STD_PX)
        if _log_std_lattice(camera).max() <= log_limit:  # nor does interpolation exceed it
            return np.ones((height, width), dtype=np.bool_)
        return np.asarray(source_log_std(camera) <= log_limit)
    mask = np.zeros((height, width), dtype=np.uint8)
    cv2.fillConvexPoly(mask, np.round(camera.domain.hull.vertices * 16).astype(np.int32), 1, shift=4)
    return mask.view(np.bool_)


def source_log_std(camera: VirtualCamera) -> NDArray[np.float32]:
    """Logarithm of the map's standard deviation in px at every pixel of the original image, (height, width).

    Interpolated between some thousand points, to about 1 % of the standard deviation; nan where the map has no answer.
    """
    return np.asarray(cv2.resize(_log_std_lattice(camera), camera.image_size), dtype=np.float32)


@lru_cache(maxsize=8)
def _log_std_lattice(camera: VirtualCamera) -> NDArray[np.float32]:
    """:func:`source_log_std` at the centres of equal cells, read-only."""
    size = np.array(camera.image_size)
    lattice = np.maximum(np.rint(LATTICE * size / size.max()), 2).astype(np.int64)
    log_std = expand(
        lambda index: np.log(camera.shape_std((index + 0.5) * (size / lattice) - 0.5) + MIN_STD_PX)[:, None],
        (int(lattice[0]), int(lattice[1])),
        outputs=1,
        tolerance=STD_TOLERANCE,
    )[0]
    return frozen(log_std, (None, None), np.float32)


def valid_pixels(camera: VirtualCamera, uv: Floats, max_std: float | None) -> Bools:
    """Which (n,) of ``uv`` (n, 2), which may lie anywhere or be nan, are valid by :func:`source_mask`."""
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((uv >= -0.5) & (uv < np.array(camera.image_size) - 0.5)).all(axis=1))
    column, row = np.rint(np.where(inside[:, None], uv, 0.0)).astype(np.int64).T
    return np.asarray(inside & source_mask(camera, max_std)[row, column])


def valid_share(camera: VirtualCamera, max_std: float | None = None) -> float:
    """The valid share of the original image."""
    return float(source_mask(camera, max_std).mean())


def valid_directions(camera: VirtualCamera, max_std: float | None) -> Floats:
    """Unit directions (n, 3) of the valid pixels of a fine grid over the image and of the domain's hull."""
    size = np.array(camera.image_size)
    count = np.maximum(np.rint(SAMPLES * size / size.max()), 2).astype(np.int64)
    step = (size - 1.0) / (count - 1.0)
    q = expand(
        lambda index: camera.plane_map.value(index * step),
        (int(count[0]), int(count[1])),
        tolerance=DIRECTION_TOLERANCE,
        dtype=np.float64,
    )
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in count)), axis=-1).reshape(-1, 2) * step
    corners = camera.domain.hull.vertices
    pixels = np.concatenate([grid, corners])
    q = np.concatenate([q.reshape(2, -1).T, camera.plane_map.value(corners)])
    known = valid_pixels(camera, pixels, max_std) & np.isfinite(q).all(axis=1)
    return camera.chart.directions(q[known])
