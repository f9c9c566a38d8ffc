"""Detection of truncated videos, which FFmpeg plays to their end without an error."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from typing import Any

from pinholify.io.video.source import opened

SHORT_TIME = Fraction(1, 10)  # s
FEW_FRAMES = 2
"""The end according to the file may exceed that of the last packet by this much, because both are rounded."""

HOLES = 4
"""Number of last frames that are ignored, because frames between them may be missing after the cut."""


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A truncated video that contains ``found`` of about ``declared`` frames."""

    found: int
    declared: int

    def of(self, path: str) -> str:
        """The sentence on the video ``path``."""
        return (
            f"'{path}' ends early: {self.found} of about {self.declared} frames are there; it was cut short or is "
            "damaged: copy it again"
        )


@dataclass(slots=True)
class _Seen:
    """Presentation times of the picture's packets, the end of the last one, and the end of all streams, in s."""

    times: list[Fraction] = field(default_factory=list)
    end: Fraction = Fraction(0)
    end_of_all: Fraction = Fraction(0)

    def longest(self) -> Fraction:
        """The longest time from one frame to the next."""
        ordered = sorted(self.times)[:-HOLES]
        return max((b - a for a, b in pairwise(ordered)), default=Fraction(0))


def shortfall(path: str) -> Shortfall | None:
    """How many frames the video ``path`` lacks of what it declares; None if none, or if it declares no length.

    Reads the whole file, but decodes nothing. Durations are compared, because frames may be omitted on purpose: that of
    the picture if the file contains it, otherwise that of all streams, of which the picture may be the shortest. Raises
    ImageError if the file is not a video.
    """
    with opened(path) as (container, stream):
        seen, rate = _seen(container, stream), stream.average_rate or stream.guessed_rate or Fraction(25)
        declared, reached = _lengths(container, stream, seen, rate)
        if not seen.times or declared is None or declared - reached <= max(FEW_FRAMES / rate, SHORT_TIME):
            return None
        found, start = len(seen.times), min(seen.times)
        about = round(found * (declared - start) / max(reached - start, 1 / rate))
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
    """The declared end of the file, None if there is none, and its actual end, in s."""
    if container.format.name == "avi":  # whose duration FFmpeg derives from the size of the file
        return stream.frames / rate, len(seen.times) / rate
    if stream.duration is not None:
        return ((stream.start_time or 0) + stream.duration) * stream.time_base, seen.end
    if container.duration is not None:
        end = Fraction((container.start_time or 0) + container.duration, 1_000_000)
        return end - seen.longest(), seen.end_of_all  # such files do not contain the duration of the last frame
    return None, seen.end
