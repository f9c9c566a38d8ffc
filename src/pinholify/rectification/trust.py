"""Where the original image may be believed: the standard deviation of every pixel, worked out once a camera."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Floats, frozen
from pinholify.camera import VirtualCamera
from pinholify.expansion import expand

SAMPLES = 96
LATTICE = 64  # places along the longer side of the image: a standard deviation changes slowly
STD_TOLERANCE = 0.1  # relative, of all that higher orders might add: in truth some per mille
SMALLEST_STD = 1e-12  # px; keeps the logarithm finite


def source_mask(camera: VirtualCamera, max_std: float | None) -> Bools:
    """Which pixels of the original image may be shown: (height, width).

    Those whose std is at most ``max_std`` px, by default the domain's limit; where that sets none, those of its hull.
    """
    width, height = camera.image_size
    limit = camera.domain.max_std if max_std is None else max_std
    if np.isfinite(limit):
        log_limit = np.log(limit + SMALLEST_STD)
        if _log_std_lattice(camera).max() <= log_limit:  # nor is then anything between its places above
            return np.ones((height, width), dtype=np.bool_)
        return np.asarray(source_log_std(camera) <= log_limit)
    mask = np.zeros((height, width), dtype=np.uint8)
    cv2.fillConvexPoly(mask, np.round(camera.domain.hull.vertices * 16).astype(np.int32), 1, shift=4)
    return mask.view(np.bool_)


def source_log_std(camera: VirtualCamera) -> NDArray[np.float32]:
    """Logarithm of the map's std in px at every pixel of the original image: (height, width).

    Interpolated between some thousand places, in truth to a per cent or so of the std; nan where the map has no answer.
    """
    return np.asarray(cv2.resize(_log_std_lattice(camera), camera.image_size), dtype=np.float32)


@lru_cache(maxsize=8)
def _log_std_lattice(camera: VirtualCamera) -> NDArray[np.float32]:
    """The same on a lattice of places in the middle of equal cells, read-only."""
    size = np.array(camera.image_size)
    lattice = np.maximum(np.rint(LATTICE * size / size.max()), 2).astype(np.int64)
    log_std = expand(
        lambda index: np.log(camera.shape_std((index + 0.5) * (size / lattice) - 0.5) + SMALLEST_STD)[:, None],
        (int(lattice[0]), int(lattice[1])),
        outputs=1,
        tolerance=STD_TOLERANCE,
    )[0]
    return frozen(log_std, (None, None), np.float32)


def believable(camera: VirtualCamera, pixels: Floats, max_std: float | None) -> Bools:
    """Where ``pixels`` (n, 2) of the image may be used: a std of at most ``max_std`` px, or inside the domain."""
    column, row = np.rint(pixels).astype(np.int64).T
    shown = np.asarray(source_mask(camera, max_std)[row, column])
    return shown & camera.domain.hull.contains(pixels) if max_std is None else shown


def shown(camera: VirtualCamera, uv: Floats, max_std: float | None) -> Bools:
    """Which of ``uv`` (n, 2), anywhere or nan, are pixels of the image that may be shown."""
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((uv >= -0.5) & (uv < np.array(camera.image_size) - 0.5)).all(axis=1))
    column, row = np.rint(np.where(inside[:, None], uv, 0.0)).astype(np.int64).T
    return np.asarray(inside & source_mask(camera, max_std)[row, column])


def image_samples(image_size: tuple[int, int]) -> Floats:
    """A grid of pixels over the whole image, its border included: (96², 2)."""
    u, v = (np.linspace(0.0, n - 1.0, SAMPLES) for n in image_size)
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
