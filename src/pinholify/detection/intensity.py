"""What detectors look at: one grey channel, whatever the image's depth and colours."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.float32]
"""(height, width) float32, in the grey levels of the image."""


def grey_levels(image: NDArray[Any]) -> Grey:
    """One float32 channel of ``image``, (height, width) or (height, width, 3 or 4) in BGR, uint8, uint16 or
    float.

    Values that are not finite count as 0. Raises ValueError for another shape.
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
    """``grey`` as uint8, its central 99 % of values spread over the whole range, so that dark pictures show
    too.
    """
    step = max(1, int(np.sqrt(grey.size / 250_000)))
    low, high = np.percentile(grey[::step, ::step], [0.5, 99.5])
    scale = 255.0 / max(float(high - low), 1e-6)
    return np.asarray(np.clip((grey - low) * scale, 0, 255), dtype=np.uint8)


def reduced(grey: Grey, level: int) -> Grey:
    """``grey`` at 1/2^``level`` of its size, each pixel the mean of those it covers; a rest at the right and below is
    cut off.

    The place uv px of ``grey`` is (uv + 0.5) / 2^``level`` - 0.5 of the result.
    """
    import cv2

    if level == 0:
        return grey
    height, width = grey.shape
    size = (width >> level, height >> level)
    whole = grey[: size[1] << level, : size[0] << level]
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
