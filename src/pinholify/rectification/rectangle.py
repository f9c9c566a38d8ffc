"""The largest rectangle of given proportions inside a mask."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Ints


@dataclass(frozen=True, slots=True)
class PixelRectangle:
    """Pixel centres from (``left``, ``top``) to (``right``, ``bottom``), which may lie between pixels."""

    left: float
    top: float
    right: float
    bottom: float


def largest_rectangle(mask: Bools, proportion: float) -> PixelRectangle | None:
    """The largest rectangle of width ÷ height = ``proportion`` whose pixels and their neighbours are all true.

    Of several, the one nearest to the middle of ``mask`` (height, width); None if all are narrower than three pixels.
    """
    sums = np.pad(mask, ((1, 0), (1, 0))).astype(np.int64).cumsum(axis=0).cumsum(axis=1)
    low, high = 0, mask.shape[1] + 1  # a rectangle of width low exists, one of width high does not
    while high - low > 1:
        width = (low + high) // 2
        low, high = (width, high) if len(_corners(sums, width, proportion)) else (low, width)
    height = _height(low, proportion)
    if min(low, height) < 5:
        return None
    corners = _corners(sums, low, proportion)
    away = np.abs(corners + (np.array([height, low]) - np.array(mask.shape)) / 2.0).sum(axis=1)
    top, left = corners[np.argmin(away)]
    return PixelRectangle(left + 1.0, top + 1.0, left + low - 2.0, top + height - 2.0)


def _height(width: int, proportion: float) -> int:
    return max(1, int(np.ceil(width / proportion)))


def _corners(sums: Ints, width: int, proportion: float) -> Ints:
    """Top left corners (n, 2), row and column, of the rectangles of ``width`` that are all true."""
    height = _height(width, proportion)
    if height >= sums.shape[0] or width >= sums.shape[1]:
        return np.empty((0, 2), dtype=np.int64)
    inside = sums[height:, width:] - sums[:-height, width:] - sums[height:, :-width] + sums[:-height, :-width]
    return np.argwhere(inside == width * height)
