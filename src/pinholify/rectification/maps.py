"""Rectification maps: for every pixel of a view, its pixel in the original image, and whether it is valid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Ints
from pinholify.camera import VirtualCamera
from pinholify.expansion import expand
from pinholify.rectification.valid_region import source_log_std, source_mask
from pinholify.rectification.views import View

Image = NDArray[np.generic]

MARGIN = 0.05  # share of the image up to which a map is expanded outside it, so that no region at its border is missed
OUTSIDE_PX = -16.0  # where sampling maps point if a pixel shows nothing: farther out than any interpolation reaches


@dataclass(frozen=True, slots=True, eq=False)
class RectificationMap:
    """The backward map from the pixels of ``view`` to those of the original image.

    ``uv`` (height, width, 2) float32: pixels of the original, nan where there are none; in memory these are two
    planes, like OpenCV's CV_32FC1 maps. ``valid`` (height, width) bool. ``std`` (height, width) float32, if it was
    requested: standard deviation of ``uv`` in px of the original, root mean square over both axes; nan outside it.
    """

    view: View
    uv: NDArray[np.float32]
    valid: Bools
    std: NDArray[np.float32] | None = None


def rectification_map(
    camera: VirtualCamera, view: View, *, max_std: float | None = None, with_std: bool = False
) -> RectificationMap:
    """The backward map of ``view``, valid where it shows a valid pixel of the image by :func:`source_mask`."""
    planes = inverse_map(camera, view)
    # A sum is the fastest test for nan, which cv2.remap treats differently on different processors.
    whole = planes if np.isfinite(planes.sum()) else np.nan_to_num(planes, nan=OUTSIDE_PX)
    mask = source_mask(camera, max_std).view(np.uint8)
    valid = cv2.remap(mask, whole[0], whole[1], cv2.INTER_NEAREST, borderValue=0).view(np.bool_)
    std = _std_at(camera, whole) if with_std else None
    return RectificationMap(view, np.moveaxis(planes, 0, -1), valid, std)


def inverse_map(camera: VirtualCamera, view: View) -> NDArray[np.float32]:
    """Pixels of the original image for those of ``view``: planes of columns and of rows, (2, height, width) float32.

    The error is below 0.01 px inside the image; nan where there is no pixel. Validity is not considered.
    """
    margin, size = MARGIN * max(camera.image_size), np.array(camera.image_size)
    return expand(
        lambda pixels: camera.project(view.directions(pixels)),
        view.size,
        wanted=lambda values: np.asarray(((values > -margin) & (values < size + margin)).all(axis=-1)),
    )


def _std_at(camera: VirtualCamera, planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Standard deviations (height, width) at the pixels ``planes`` (2, height, width); nan outside the image."""
    log_std = source_log_std(camera)
    found = cv2.remap(log_std, planes[0], planes[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where(_within(planes, camera.image_size), np.exp(found), np.float32(np.nan))


def _within(planes: NDArray[np.float32], image_size: tuple[int, int]) -> Bools:
    """Which of the pixels ``planes`` (2, height, width) lie in an image of ``image_size`` (width, height)."""
    inside = [(plane >= -0.5) & (plane <= n - 0.5) for plane, n in zip(planes, image_size, strict=True)]
    return np.asarray(inside[0] & inside[1])


@dataclass(frozen=True, slots=True, eq=False)
class Sampler:
    """Resamples images to a view by the maps ``map1`` and ``map2`` of ``cv2.remap``.

    ``rim`` (n, 256) are the flat positions in the view whose interpolation reaches beyond the image, ``rim_maps`` the
    maps there. A call costs no more than ``cv2.remap`` with the same maps.
    """

    map1: NDArray[np.generic]
    map2: NDArray[np.generic]
    rim: Ints
    rim_maps: tuple[NDArray[np.generic], NDArray[np.generic]]

    def __call__(self, image: Image) -> Image:
        """The view of ``image`` (h, w[, c]) of any dtype, by cubic interpolation; black where not valid."""
        source = _supported(image)
        out = np.zeros((*self.map1.shape[:2], *image.shape[2:]), dtype=source.dtype)
        # BORDER_TRANSPARENT skips pixels that point outside the image, and also those at its rim, which follow.
        cv2.remap(source, self.map1, self.map2, cv2.INTER_CUBIC, dst=out, borderMode=cv2.BORDER_TRANSPARENT)
        if len(self.rim):
            rim = cv2.remap(source, *self.rim_maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
            out.reshape(-1, *image.shape[2:])[self.rim] = rim.reshape(*self.rim.shape, *image.shape[2:])
        return _of_type(out, image.dtype)


def sampler(rectification: RectificationMap, image_size: tuple[int, int], *, fixed_point: bool = False) -> Sampler:
    """The :class:`Sampler` of a map for images of ``image_size`` (width, height).

    ``fixed_point`` maps have a resolution of 1/32 px and take three quarters of the memory; OpenCV 4 rounds all maps
    like this.
    """
    valid = rectification.valid
    planes = [
        np.where(valid, np.clip(rectification.uv[:, :, k], 0, n - 1), np.float32(OUTSIDE_PX))
        for k, n in enumerate(image_size)
    ]
    maps = cv2.convertMaps(planes[0], planes[1], cv2.CV_16SC2) if fixed_point else planes
    reach = [(plane < 1) | (plane >= n - 2) for plane, n in zip(planes, image_size, strict=True)]
    places = np.flatnonzero((reach[0] | reach[1]) & valid)
    rim = np.resize(places, (-(-len(places) // 256), 256))  # an image for cv2.remap, filled up by repetition
    rim_maps = [m.reshape(valid.size, *m.shape[2:])[rim] for m in maps]
    return Sampler(maps[0], maps[1], rim, (rim_maps[0], rim_maps[1]))


def remap(image: Image, rectification: RectificationMap) -> Image:
    """``image`` (h, w[, c]) of any dtype, resampled to the view by cubic interpolation; black where not valid."""
    return sampler(rectification, (image.shape[1], image.shape[0]))(image)


def _supported(image: Image) -> Image:
    """The image in a dtype that ``cv2.remap`` supports; others are converted to float64."""
    known = image.dtype in (np.uint8, np.uint16, np.int16, np.float32, np.float64)
    return image if known else image.astype(np.float64)


def _of_type(image: Image, dtype: np.dtype[Any]) -> Image:
    """The image in the ``dtype`` that it had before :func:`_supported`, rounded if that is an integer type."""
    if image.dtype == dtype:
        return image
    return np.rint(image).astype(dtype) if np.issubdtype(dtype, np.integer) else image.astype(dtype)
