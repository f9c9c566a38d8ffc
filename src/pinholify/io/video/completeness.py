"""Whether a video is all there: copies that were broken off play without a word, up to where they end."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from typing import Any

from pinholify.io.video.source import opened

SHORT_TIME = Fraction(1, 10)  # s
FEW_FRAMES = 2
"""By so much the end that a file tells may come later than that of its last packet: both are rounded."""

HOLES = 4
"""Packets at the end of a cut among which some that come later in the file are missing."""


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A video of which ``found`` frames are there, of about ``declared``."""

    found: int
    declared: int

    def of(self, path: str) -> str:
        """The sentence about the video ``path``."""
        return (
            f"'{path}' ends early: {self.found} of about {self.declared} frames are there; it was cut short or is "
            "damaged: copy it again"
        )


@dataclass(slots=True)
class _Seen:
    """When the picture's packets are shown, when the last of them ends, and the same of all streams together, in s."""

    times: list[Fraction] = field(default_factory=list)
    end: Fraction = Fraction(0)
    end_of_all: Fraction = Fraction(0)

    def longest(self) -> Fraction:
        """The longest that a frame is shown until the next."""
        ordered = sorted(self.times)[:-HOLES]
        return max((b - a for a, b in pairwise(ordered)), default=Fraction(0))


def shortfall(path: str) -> Shortfall | None:
    """What the video ``path`` lacks of what it says it holds; None where that is nothing, or where it says nothing.

    Reads the whole file, but decodes nothing. What counts is time, as frames may be left out by intent: the picture's
    own length where the file tells it, else that of all streams together, of which the picture may be the shortest.
    Raises ImageError for what is no video.
    """
    with opened(path) as (container, stream):
        seen, rate = _seen(container, stream), stream.average_rate or stream.guessed_rate or Fraction(25)
        told, reached = _lengths(container, stream, seen, rate)
        if not seen.times or told is None or told - reached <= max(FEW_FRAMES / rate, SHORT_TIME):
            return None
        found, start = len(seen.times), min(seen.times)
        about = round(found * (told - start) / max(reached - start, 1 / rate))
        return Shortfall(found, max(stream.frames or about, found + 1))


def _seen(container: Any, stream: Any) -> _Seen:
    seen = _Seen()
    for packet in container.demux():
        if not packet.size or packet.pts is None:
            continue
        end = (packet.pts + (packet.duration or 0)) * packet.time_base
        seen.end_of_all = max(seen.end_of_all, end)
        if packet.stream_index == stream.index:
            seen.times.append(packet.pts * packet.time_base)
            seen.end = max(seen.end, end)
    return seen


def _lengths(container: Any, stream: Any, seen: _Seen, rate: Fraction) -> tuple[Fraction | None, Fraction]:
    """When the file says that it ends, None where it does not, and when it does, in s."""
    if container.format.name == "avi":  # whose length in time is worked out from that of the file
        return stream.frames / rate, len(seen.times) / rate
    if stream.duration is not None:
        return ((stream.start_time or 0) + stream.duration) * stream.time_base, seen.end
    if container.duration is not None:
        end = Fraction((container.start_time or 0) + container.duration, 1_000_000)
        return end - seen.longest(), seen.end_of_all  # such files do not say how long the last frame is shown
    return None, seen.end
