"""Whether the captures can be those of the patterns in their order: none exchanged, doubled or lost.

Three properties hold for every camera and every pose of the screen: a picture and its inverse add up to white;
neighbouring stripes of a Gray code differ by one; and each step of a wave is shifted against the stripes by its share
of the period.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Floats, Ints
from pinholify.detection.gray_code.patterns import Pattern, Sequence
from pinholify.detection.intensity import Grey
from pinholify.errors import ImageError

LEVEL_TOLERANCE = 0.15
"""A picture and its inverse contradict each other where both are this close to black (0), or to white (1)."""

SUSPICIOUS_SHARE = 0.2
"""Share of the pixels, or of the stripes' borders, that must be contradictory: noise and hands spoil fewer."""

SATURATED_LEVEL = 0.98
"""Share of the sensor's range at which a white picture may be overexposed, so that grey looks white as well."""

EDGE_CONTRAST = 0.5
"""Where the contrast falls below this share within three pixels, the screen or its reflection ends."""

LIT_FACTOR = 2.0
"""Contrast, in multiples of a lit pixel's least, that proves a pixel lit which the white and black pictures call unlit.
"""

AMPLITUDE_RATIO = 0.75
"""Smallest ratio of the amplitude of a wave's step to the median one, or of the median one to it."""

MIN_BORDERS = 30
"""Borders of stripes needed to check their order."""

MIN_PIXELS = 500
"""Pixels needed to check a wave."""

MIN_KNOWN_SHARE = 0.5
"""If fewer of the pixels that see the screen see the stripes, those that do are at edges and of no use."""

MIN_PERIODS = 2
"""Periods of the wave that must be visible: with fewer, its fit depends on where the stripes are cut off."""

SAMPLED_LINES = 400
"""Rows and columns of pixels that are examined."""

MIN_ANGLE_RAD = np.pi / 16.0
"""Phase below which a shift cannot be distinguished from the width of the stripes."""


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """The screen in the captures called ``name``: the ``black`` picture, and ``contrast``, white minus black.

    Both are (height, width), 0 … 1. The screen is visible where ``contrast`` is above ``least``.
    """

    name: str
    sequence: Sequence
    black: Grey
    contrast: Grey
    least: float

    @property
    def where(self) -> Bools:
        """The pixels (height, width) that see the screen."""
        return np.asarray(self.contrast > self.least)

    def strides(self) -> tuple[int, int]:
        """Strides of the rows and of the columns that are examined."""
        height, width = self.contrast.shape
        return max(1, height // SAMPLED_LINES), max(1, width // SAMPLED_LINES)

    def sample(self, image: NDArray[Any]) -> NDArray[Any]:
        """The values (n,) of ``image`` (height, width) at some of the pixels that see the screen."""
        rows, columns = self.strides()
        return np.asarray(image[::rows, ::columns][self.contrast[::rows, ::columns] > self.least])

    def levels(self, frame: Grey) -> Grey:
        """:meth:`sample` of a capture, scaled: 0 as in the black picture, 1 as in the white one."""
        return np.asarray((self.sample(frame) - self.sample(self.black)) / self.sample(self.contrast))


def check_inverse(picture: Grey, inverse: Grey, lit: Lit, pattern: Pattern) -> None:
    """Raise ImageError if ``picture`` and ``inverse`` are both white, or both black, in too many pixels.

    Also if they show a screen that the white and the black picture do not.
    """
    beyond = ~lit.where & (np.abs(picture - inverse) > LIT_FACTOR * lit.least)
    if np.count_nonzero(beyond) > SUSPICIOUS_SHARE * np.count_nonzero(lit.where):
        raise _disordered(lit, [Pattern("white"), Pattern("black")], "do not show all of the screen, or all of it lit")
    levels = lit.levels(picture), lit.levels(inverse)
    white = lit.sample(lit.black) + lit.sample(lit.contrast)
    both_white = (np.minimum(*levels) > 1.0 - LEVEL_TOLERANCE) & (white < SATURATED_LEVEL)
    both_black = np.maximum(*levels) < LEVEL_TOLERANCE
    if (both_white | both_black).sum() > SUSPICIOUS_SHARE * len(white):
        raise _disordered(lit, _pair(pattern), "are not a picture and its inverse")


def check_borders(number: Ints, clear: Bools, lit: Lit, pattern: Pattern) -> None:
    """Raise ImageError if neighbouring stripes differ by more than one in ``number`` (height, width).

    ``number`` is decoded from the stripes down to those of ``pattern``, and examined where these are ``clear``. At a
    border of coarser stripes it changes by one only if all pictures are in order.
    """
    rows, columns = lit.strides()
    contrast = np.where(clear & lit.where, lit.contrast, np.float32(0.0))
    along_rows = _steps(number[::rows], contrast[::rows])
    steps = np.concatenate([along_rows, _steps(number[:, ::columns].T, contrast[:, ::columns].T)])
    if len(steps) >= MIN_BORDERS and (steps > 1).mean() > SUSPICIOUS_SHARE:
        raise _disordered(lit, _pair(pattern), "do not fit the coarser stripes before them")


def _steps(number: Ints, contrast: Grey) -> Ints:
    """Steps of ``number`` along rows, at borders of coarser stripes with two equal pixels on either side.

    Pixels without ``contrast`` are ignored.
    """
    end = number.shape[1] - 3
    before, left, right, after = (number[:, i : end + i] for i in range(4))
    seen = np.stack([contrast[:, i : end + i] for i in range(4)])
    border = (left >> 1 != right >> 1) & (before == left) & (right == after)
    border &= seen.min(axis=0) > EDGE_CONTRAST * seen.max(axis=0)
    return np.asarray(np.abs(left[border] - right[border]))


def check_waves(waves: list[Grey], place: Grey, known: Bools, lit: Lit, axis: int) -> None:
    """Raise ImageError if a step of the ``waves`` along ``axis`` is not shifted as it should be.

    ``waves`` are the steps' :meth:`Lit.levels`; ``place`` (height, width) is decoded from the stripes, in screen px,
    and valid where ``known``.
    """
    where = lit.sample(known)
    levels, places = np.stack(waves)[:, where].astype(np.float64), lit.sample(place)[where]
    period = lit.sequence.period
    enough = levels.shape[1] >= max(MIN_PIXELS, MIN_KNOWN_SHARE * len(where))
    if not enough or np.ptp(np.quantile(places, (0.1, 0.9))) < MIN_PERIODS * period:
        return
    if wrong := _misplaced(levels, 2.0 * np.pi / period * places):
        patterns = [Pattern("wave", axis, step) for step in wrong]
        they_are = "is not shifted as it" if len(wrong) == 1 else "are not shifted as they"
        raise _disordered(lit, patterns, f"{they_are} should be against the stripes")


def _misplaced(levels: Floats, phase: Floats) -> list[int]:
    """The steps of a wave whose ``levels`` (steps, n) do not follow ``phase`` (n,) with the shift of their number.

    A wave of that phase is fitted to each step; if the pixels see a wave that the fits do not, the steps do not belong
    to the stripes.
    """
    turns = np.exp(2j * np.pi * np.arange(len(levels)) / len(levels))
    seen = 2.0 / len(levels) * float(np.median(np.abs(turns @ levels)))
    if seen < LEVEL_TOLERANCE / 2.0:
        return []
    design = np.column_stack([np.ones_like(phase), np.cos(phase), np.sin(phase)])
    _, cosine, sine = np.linalg.lstsq(design, levels.T, rcond=1e-6)[0]
    found = (cosine + 1j * sine) / turns
    amplitude = np.abs(found)
    typical = float(np.median(amplitude))
    wrong = np.abs(np.angle(found)) > max(np.pi / len(levels), MIN_ANGLE_RAD)
    wrong |= (amplitude < max(AMPLITUDE_RATIO * typical, seen / 2.0)) | (amplitude > typical / AMPLITUDE_RATIO)
    return [int(step) for step in np.flatnonzero(wrong)]


def _pair(pattern: Pattern) -> list[Pattern]:
    return [pattern, Pattern("inverse", pattern.axis, pattern.index)]


def _disordered(lit: Lit, patterns: list[Pattern], what: str) -> ImageError:
    every = lit.sequence.patterns
    named = [f"{every.index(pattern) + 1} ({pattern.name})" for pattern in patterns]
    which = ", ".join(named[:-1]) + " and " * (len(named) > 1) + named[-1]
    return ImageError(
        f"the captures in '{lit.name}' do not follow the order of the patterns: number{'s' * (len(named) > 1)} {which} "
        f"{what}; look for captures that are exchanged, doubled or lost, or capture this pose again"
    )
