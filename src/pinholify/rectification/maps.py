"""Rectification maps: for every pixel of a view, where the original image shows it, and whether to believe it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools
from pinholify.camera import VirtualCamera
from pinholify.rectification.expansion import expand
from pinholify.rectification.views import SAMPLES, View, image_samples

Image = NDArray[np.generic]

FILLS = 5
MARGIN = 0.05  # of the image: how far outside it a map is still followed, so that no node misses its border


@dataclass(frozen=True, slots=True, eq=False)
class RectificationMap:
    """``uv`` (height, width, 2) float32: pixels of the original for ``view``'s; ``valid`` (height, width) bool."""

    view: View
    uv: NDArray[np.float32]
    valid: Bools


def rectification_map(camera: VirtualCamera, view: View, *, max_std: float | None = None) -> RectificationMap:
    """The backward map of ``view``; valid inside the domain, or where the std is at most ``max_std`` px."""
    margin, size = MARGIN * max(camera.image_size), np.array(camera.image_size)
    uv = expand(
        lambda pixels: camera.project(view.directions(pixels)),
        view.size,
        wanted=lambda values: np.asarray(((values > -margin) & (values < size + margin)).all(axis=-1)),
    )
    source = source_mask(camera, max_std).astype(np.uint8)
    valid = cv2.remap(source, np.nan_to_num(uv, nan=-1.0), None, cv2.INTER_NEAREST, borderValue=0)
    return RectificationMap(view, uv, valid.astype(bool))


def source_mask(camera: VirtualCamera, max_std: float | None) -> Bools:
    """Which pixels of the original image may be believed: (height, width)."""
    width, height = camera.image_size
    if max_std is None and np.isinf(camera.domain.max_std):
        mask = np.zeros((height, width), dtype=np.uint8)
        hull = np.round(camera.domain.hull.vertices * 16).astype(np.int32)
        cv2.fillConvexPoly(mask, hull, 1, shift=4)
        return mask.astype(bool)
    limit = camera.domain.max_std if max_std is None else max_std
    log_std = np.log(camera.shape_std(image_samples(camera.image_size)) + 1e-12).astype(np.float32)
    return np.asarray(_upsampled(log_std.reshape(SAMPLES, SAMPLES), width, height) <= np.log(limit + 1e-12))


def _upsampled(grid: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """A grid over the whole image, border to border, interpolated at every pixel."""
    x = np.linspace(0.0, SAMPLES - 1.0, width, dtype=np.float32)
    y = np.linspace(0.0, SAMPLES - 1.0, height, dtype=np.float32)
    return np.asarray(cv2.remap(grid, *np.meshgrid(x, y), cv2.INTER_LINEAR))


def remap(image: Image, rectification: RectificationMap) -> Image:
    """``image`` (h, w[, c]) of any depth resampled to the view by cubic interpolation; black where not valid."""
    uv = np.nan_to_num(rectification.uv, nan=-1.0)
    out = cv2.remap(_supported(image), uv, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    out = out.astype(image.dtype, copy=False)
    out[~rectification.valid] = 0
    return np.asarray(out)


def splat(image: Image, camera: VirtualCamera, view: View, *, max_std: float | None = None) -> Image:
    """The paper's way: every pixel forward to its rounded place, holes filled by the median of their neighbours."""
    width, height = view.size
    to_view = expand(lambda uv: view.project(camera.to_rays(uv).directions), camera.image_size, tolerance=0.05)
    target = np.full((*to_view.shape[:2], 2), -1, dtype=np.int64)
    known = np.isfinite(to_view).all(axis=2) & source_mask(camera, max_std)
    target[known] = np.rint(np.clip(to_view[known], -1, 1 << 30)).astype(np.int64)
    inside = (target >= 0).all(axis=2) & (target < [width, height]).all(axis=2)
    out = np.zeros((height, width, *image.shape[2:]), dtype=image.dtype)
    filled = np.zeros((height, width), dtype=bool)
    x, y = target[inside].T
    out[y, x], filled[y, x] = image[inside], True
    return _fill_holes(out, filled)


def _fill_holes(image: Image, filled: Bools) -> Image:
    """Every empty pixel with at least three filled ones around it gets their median, by channel, a few times."""
    for _ in range(FILLS):
        padded = np.pad(filled, 1)
        windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
        holes = ~filled & (windows.sum(axis=(2, 3)) >= 3)
        y, x = np.nonzero(holes)
        edge = [(1, 1), (1, 1)] + [(0, 0)] * (image.ndim - 2)
        values = np.lib.stride_tricks.sliding_window_view(np.pad(image, edge), (3, 3), axis=(0, 1))[y, x]
        around = windows[y, x].reshape((len(y), *([1] * (image.ndim - 2)), 3, 3))
        neighbours = np.where(around, values, np.nan).reshape(*values.shape[:-2], 9)
        image[y, x] = np.nanmedian(neighbours, axis=-1).astype(image.dtype)
        filled = filled | holes
    return image


def _supported(image: Image) -> Image:
    """The image in a depth that OpenCV's remap knows; others go through float64."""
    known = image.dtype in (np.uint8, np.uint16, np.int16, np.float32, np.float64)
    return image if known else image.astype(np.float64)


