"""The input of all detectors: one grey channel, whatever the image's depth and colours."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.float32]
"""(height, width) float32, in the grey levels of the image."""

MIN_SIDE_PX = 24
"""Images with a side below this (px) are too small to show the corners of a board."""


def grey_levels(image: NDArray[Any]) -> Grey:
    """The grey levels of ``image`` as one float32 channel.

    ``image`` is (height, width) or (height, width, 1, 3 or 4), BGR, of type uint8, uint16 or float. Values that are not
    finite become 0. Raises ValueError for another shape.
    """
    import cv2

    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
        raise ValueError(f"an image of shape {image.shape} was given where (height, width[, 3]) is needed")
    if image.ndim == 3:
        image = image[:, :, 0] if image.shape[2] == 1 else cv2.cvtColor(image[:, :, :3], cv2.COLOR_BGR2GRAY)
    grey = np.ascontiguousarray(image, dtype=np.float32)
    if image.dtype.kind == "f":
        grey = np.nan_to_num(grey, nan=0.0, posinf=0.0, neginf=0.0)
    return grey


def stretched(grey: Grey) -> NDArray[np.uint8]:
    """``grey`` as uint8, with the central 99 % of its values stretched to the full range, for dark images."""
    step = max(1, int(np.sqrt(grey.size / 250_000)))
    low, high = np.percentile(grey[::step, ::step], [0.5, 99.5])
    scale = 255.0 / max(float(high - low), 1e-6)
    return np.asarray(np.clip((grey - low) * scale, 0, 255), dtype=np.uint8)


def halvings(grey: Grey, side: int) -> int:
    """How often ``grey`` has to be halved for its width and height to be at most ``side`` px."""
    level = 0
    while max(grey.shape) / 2**level > side:
        level += 1
    return level


def reduced(grey: Grey, level: int) -> Grey:
    """``grey`` at 1/2^``level`` of its size, each pixel the mean of those that it covers.

    Rows and columns left over at the bottom and the right are dropped. The pixel uv of ``grey`` is
    (uv + 0.5) / 2^``level`` - 0.5 in the result.
    """
    import cv2

    if level == 0:
        return grey
    height, width = grey.shape
    size = (width >> level, height >> level)
    whole = grey[: size[1] << level, : size[0] << level]
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
