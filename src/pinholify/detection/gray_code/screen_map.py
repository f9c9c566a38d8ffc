"""Captures of all pictures to the screen pixel that each camera pixel sees."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from pinholify.arrays import Bools, frozen
from pinholify.detection.gray_code.consistency import Lit, check_borders, check_inverse, check_waves
from pinholify.detection.gray_code.patterns import PARTS_OF_WAVE, Pattern, Sequence
from pinholify.detection.intensity import Grey
from pinholify.errors import ImageError

MIN_SCREEN_CONTRAST = 0.03
"""White minus black, as a share of the sensor's range, below which no screen is visible."""

LIT_SHARE = 0.1
"""White minus black, as a share of that of the brightest part, above which a pixel sees the screen."""

RESOLVED_CONTRAST = 0.15
"""Contrast of stripes, as a share of white minus black, below which a pixel does not resolve them."""

COARSEST_PX = 4
"""Width in screen px of the widest stripe that locates a pixel well enough."""

MAX_SHIFT_PX = 0.3
"""Camera px between the first and the last picture above which something has moved."""

SHIFT_BLUR_PX = 2.0
"""Standard deviation, in camera px, of the blur before a shift is measured."""


@dataclass(frozen=True, slots=True, eq=False)
class ScreenMap:
    """``x`` and ``y`` (height, width) float32: the screen pixel (integer = centre) that each camera pixel sees.

    Both are nan where it is not known.
    """

    x: NDArray[np.float32]
    y: NDArray[np.float32]

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", frozen(self.x, (None, None), np.float32))
        object.__setattr__(self, "y", frozen(self.y, self.x.shape, np.float32))


def decode(captures: Iterable[Grey], sequence: Sequence, name: str) -> ScreenMap:
    """The screen as seen in ``captures`` (height, width), 0 … 1, one for each of the sequence's patterns in order.

    ``name`` is used in messages. Raises ImageError if no lit screen is visible, if the captures cannot be those of the
    patterns in order, and if something moved.
    """
    frames = iter(captures)
    first, white, black = next(frames), next(frames), next(frames)
    contrast = white - black
    lit = Lit(name, sequence, black, contrast, LIT_SHARE * _brightest(contrast, name))
    axes = [_along(frames, axis, lit) for axis in (0, 1)]
    shift = shift_between(first, next(frames), lit.where)
    if not shift < MAX_SHIFT_PX:
        raise ImageError(
            f"the camera or the screen moved by {shift:.1f} px or more while '{name}' was captured: fix both and "
            "capture all its patterns again"
        )
    known = lit.where & np.isfinite(axes[0]) & np.isfinite(axes[1])
    return ScreenMap(*(np.where(known, place, np.nan) for place in axes))


def _brightest(contrast: Grey, name: str) -> float:
    brightest = float(np.quantile(contrast[::2, ::2], 0.999))
    if brightest < MIN_SCREEN_CONTRAST:
        raise ImageError(
            f"no lit screen is seen in '{name}': its white picture is hardly brighter than its black one (by "
            f"{max(0.0, 255 * brightest):.0f} grey levels of 255); check the order of the captures, the exposure and "
            "the direction of the camera"
        )
    return brightest


def _along(frames: Iterator[Grey], axis: int, lit: Lit) -> Grey:
    """The screen's column (``axis`` 0) or row (1) at each pixel, (height, width); nan where it is not known."""
    place, interval = _gray_place(frames, axis, lit)
    if lit.sequence.steps:
        place, interval = _wave_place(frames, axis, lit, place, interval)
    known = (interval <= COARSEST_PX) & (place > -0.5) & (place < lit.sequence.size[axis] - 0.5)
    return np.where(known, place, np.float32(np.nan))


def _gray_place(frames: Iterator[Grey], axis: int, lit: Lit) -> tuple[Grey, Grey]:
    """The middle of the stripe that each pixel sees, and the width of that stripe, in screen px.

    A bit that is too faint matters only if all finer ones are too: the border of a bit's stripes is the middle of a
    stripe of the next coarser one, so a pixel there is located even better.
    """
    number = np.zeros(lit.contrast.shape, np.int64)
    blurred = np.zeros(lit.contrast.shape, np.int64)  # how many of the finest bits are too faint
    for bit in lit.sequence.bits(axis):
        picture, inverse = next(frames), next(frames)
        pattern = Pattern("bit", axis, bit)
        check_inverse(picture, inverse, lit, pattern)
        difference = picture - inverse
        number = number << 1 | (number & 1) ^ (difference > 0)
        clear = np.abs(difference) >= RESOLVED_CONTRAST * lit.contrast
        check_borders(number, clear, lit, pattern)
        blurred = np.where(clear, 0, blurred + 1)
    shift = blurred + lit.sequence.finest
    start = number << lit.sequence.finest >> shift << shift
    width = np.left_shift(1, shift)
    return (start + 0.5 * (width - 1)).astype(np.float32), width.astype(np.float32)


def _wave_place(frames: Iterator[Grey], axis: int, lit: Lit, place: Grey, interval: Grey) -> tuple[Grey, Grey]:
    """The position by the wave's phase, with the period taken from the Gray code's ``place``, and its interval.

    The phase is that of the fundamental of the steps' discrete Fourier transform: with ``steps`` pictures, overtones of
    a gamma below the order steps − 1 have no effect.
    """
    steps, period = lit.sequence.steps, np.float32(lit.sequence.period)
    sine, cosine = np.zeros_like(lit.contrast), np.zeros_like(lit.contrast)
    levels = []
    for step in range(steps):
        frame, angle = next(frames), 2.0 * np.pi * step / steps
        sine += np.float32(np.sin(angle)) * frame
        cosine += np.float32(np.cos(angle)) * frame
        levels.append(lit.levels(frame))
    check_waves(levels, place, interval <= period / PARTS_OF_WAVE, lit, axis)
    fraction = np.arctan2(sine, cosine) * (period / np.float32(2.0 * np.pi))
    exact = fraction + period * np.rint((place - fraction) / period)
    amplitude = np.hypot(sine, cosine) * np.float32(2.0 / steps)
    sure = (amplitude > RESOLVED_CONTRAST / 2.0 * lit.contrast) & (interval <= period / 2.0)
    return exact, np.where(sure, np.float32(0.0), np.float32(np.inf))


def shift_between(first: Grey, last: Grey, where: Bools) -> float:
    """Shift (px) from ``first`` to ``last`` of the content at ``where`` (height, width): the largest of four quarters.

    By the images' gradients (Lucas & Kanade 1981): exact for small shifts, and some pixels for large ones.
    """
    smooth = [gaussian_filter(frame, SHIFT_BLUR_PX) for frame in (first, last)]
    v_slope, u_slope = np.gradient((smooth[0] + smooth[1]) / 2.0)
    change = smooth[0] - smooth[1]
    rows, columns = np.flatnonzero(where.any(axis=1)), np.flatnonzero(where.any(axis=0))
    shifts = [0.0]
    for vertical in np.array_split(rows, 2):
        for horizontal in np.array_split(columns, 2):
            part = np.ix_(vertical, horizontal)
            slopes = np.column_stack([u_slope[part].ravel(), v_slope[part].ravel()]).astype(np.float64)
            shift = np.linalg.lstsq(slopes.T @ slopes, slopes.T @ change[part].ravel(), rcond=1e-6)[0]
            shifts.append(float(np.linalg.norm(shift)))
    return max(shifts)
