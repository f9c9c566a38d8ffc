"""The sequence of pictures that a screen shows, by which each of its pixels can be identified.

A reflected Gray code (Gray 1953; for screens: Inokuchi, Sato & Matsuda 1984) numbers columns and rows: neighbours
differ in one bit, so the error of a pixel at the border of two stripes is one at most. Each stripe picture is followed
by its inverse, and only the two are compared, so that neither ambient light nor the screen's gamma matters. Waves
(phase shifts; Srinivasan, Liu & Halioua 1984) add fractions of a screen pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Ints
from pinholify.errors import InputError

AXES = ("column", "row")
CHECKS = 12
"""Squares of the check picture along the screen's shorter side."""

PARTS_OF_WAVE = 4
"""Stripes into which the Gray code must divide a wave's period, so that the period is never mistaken."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """One picture of ``kind`` ``check``, ``white``, ``black``, ``bit``, ``inverse`` or ``wave``.

    ``axis`` is 0 if it numbers columns and 1 if rows; ``index`` is a bit's number, 0 the finest, or a wave's step.
    """

    kind: str
    axis: int = 0
    index: int = 0

    @property
    def name(self) -> str:
        """The name used in file names, e.g. ``column-bit7-inverse``."""
        if self.kind not in ("bit", "inverse", "wave"):
            return self.kind
        what = "wave" if self.kind == "wave" else "bit"
        return f"{AXES[self.axis]}-{what}{self.index}" + "-inverse" * (self.kind == "inverse")


@dataclass(frozen=True, slots=True)
class Sequence:
    """All pictures for a screen of ``size`` (width, height) px.

    There are ``steps`` pictures per wave of ``period`` screen px, or no waves if ``steps`` is 0; bits that waves make
    unnecessary are left out. ``pixel_mm`` is the pitch of the screen's pixels, if known. Raises InputError for one or
    two steps, for periods that are not a power of two of at least 8, and for sides below 32 px or above 32768 px.
    """

    size: tuple[int, int]
    steps: int = 0
    period: int = 32
    pixel_mm: float | None = None

    def __post_init__(self) -> None:
        if min(self.size) < 32 or max(self.size) > 1 << 15:
            raise InputError(
                f"a screen of {self.size[0]}x{self.size[1]} px was given; its sides must be 32 to {1 << 15} px"
            )
        if self.steps < 0 or self.steps in (1, 2):
            raise InputError(f"{self.steps} steps per wave were requested; it takes 3 or more, or 0 for no waves")
        if self.period < 8 or self.period & (self.period - 1):
            raise InputError(f"a wave of {self.period} px was requested; its period must be 8, 16, 32 or so on")

    @property
    def finest(self) -> int:
        """Number of the finest bit that is shown; 0 is the finest of all."""
        return (self.period // PARTS_OF_WAVE).bit_length() - 1 if self.steps else 0

    def bits(self, axis: int) -> range:
        """Numbers of the bits along ``axis``, coarsest first."""
        return range((self.size[axis] - 1).bit_length() - 1, self.finest - 1, -1)

    @property
    def patterns(self) -> tuple[Pattern, ...]:
        """All pictures in order; the check picture comes first and last, to detect motion."""
        return (Pattern("check"), Pattern("white"), Pattern("black"), *self._axis(0), *self._axis(1), Pattern("check"))

    def _axis(self, axis: int) -> Iterator[Pattern]:
        for bit in self.bits(axis):
            yield Pattern("bit", axis, bit)
            yield Pattern("inverse", axis, bit)
        for step in range(self.steps):
            yield Pattern("wave", axis, step)

    @property
    def files(self) -> tuple[str, ...]:
        """A file name for each picture; sorting keeps their order."""
        digits = len(str(len(self.patterns)))
        return tuple(f"{i:0{digits}d}-{pattern.name}.png" for i, pattern in enumerate(self.patterns))

    def picture(self, pattern: Pattern) -> NDArray[np.uint8]:
        """The picture of ``pattern`` for the screen: (height, width) uint8, 0 black, 255 white."""
        width, height = self.size
        if pattern.kind == "check":
            side = max(1, min(self.size) // CHECKS)
            light = (np.arange(height)[:, None] // side + np.arange(width) // side) % 2
            return np.asarray(255 * light, dtype=np.uint8)
        if pattern.kind in ("white", "black"):
            return np.full((height, width), 255 * (pattern.kind == "white"), dtype=np.uint8)
        levels = self._levels(pattern)
        whole = np.broadcast_to(levels if pattern.axis == 0 else levels[:, None], (height, width))
        return np.ascontiguousarray(whole)

    def _levels(self, pattern: Pattern) -> NDArray[np.uint8]:
        """The grey levels along the axis, (width or height,)."""
        place = np.arange(self.size[pattern.axis])
        if pattern.kind == "wave":
            phase = 2.0 * np.pi * (place / self.period - pattern.index / self.steps)
            return np.rint(127.5 * (1.0 + np.cos(phase))).astype(np.uint8)
        light = (gray_code(place) >> pattern.index & 1) ^ (pattern.kind == "inverse")
        return np.asarray(255 * light, dtype=np.uint8)


def gray_code(number: Ints) -> Ints:
    """The reflected Gray code of ``number``."""
    return np.asarray(number ^ (number >> 1))
