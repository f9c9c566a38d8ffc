"""Encoded video in parts, each an atomically written file, from which an interrupted run continues.

A part is an ``.npz`` archive of plain arrays: the concatenated bytes of the packets, and for each packet its size, its
presentation time, and whether it is a key frame. Video containers would round or shift the times.
"""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Ints
from pinholify.io.files import atomic_path, make_folder
from pinholify.io.video.encoding import Encoding
from pinholify.io.video.source import Frame


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """Packets in decoding order: ``pts`` (n,), ``size`` (n,) in bytes, ``key`` (n,), and all their ``data``.

    ``end`` is the time at which the last frame ends.
    """

    data: NDArray[np.uint8]
    size: Ints
    pts: Ints
    key: Bools
    end: int


def encode(encoding: Encoding, frames: Iterable[Frame]) -> Segment | None:
    """Encode ``frames`` with a new encoder, so that the part can be decoded alone; None if there are none."""
    waiting = iter(frames)
    first = next(waiting, None)
    if first is None:
        return None
    encoder = encoding.open()
    packets: list[Any] = []
    end = 0
    for frame in chain([first], waiting):
        end = frame.pts + (frame.duration or 0)
        packets += encoder.encode(frame)
    packets += encoder.encode(None)
    data = np.frombuffer(b"".join(bytes(packet) for packet in packets), dtype=np.uint8)
    return Segment(
        data,
        np.array([packet.size for packet in packets], dtype=np.int64),
        np.array([packet.pts for packet in packets], dtype=np.int64),
        np.array([packet.is_keyframe for packet in packets], dtype=np.bool_),
        end,
    )


@dataclass(frozen=True, slots=True)
class SegmentFolder:
    """The parts of one video in a ``folder``, numbered from 0; ``index`` has all of them without their data."""

    folder: Path
    index: list[Segment] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        while (segment := _read(self._path(len(self.index)))) is not None:
            self._note(segment)

    @property
    def frames(self) -> int:
        """The number of frames in all parts."""
        return sum(len(segment.pts) for segment in self.index)

    @property
    def last(self) -> int | None:
        """The presentation time of the last frame, None if there are no parts."""
        return int(self.index[-1].pts.max()) if self.index else None

    def add(self, segment: Segment) -> None:
        """Write the next part."""
        make_folder(self.folder)
        with atomic_path(self._path(len(self.index))) as temporary, temporary.open("wb") as file:
            np.savez(file, data=segment.data, size=segment.size, pts=segment.pts, key=segment.key, end=segment.end)
        self._note(segment)

    def __iter__(self) -> Iterator[Segment]:
        """The parts, read one at a time."""
        for number in range(len(self.index)):
            segment = _read(self._path(number))
            if segment is None:
                raise OSError(f"{self._path(number)} has disappeared")
            yield segment

    def remove(self) -> None:
        """Remove the folder and all parts."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _note(self, segment: Segment) -> None:
        self.index.append(Segment(segment.data[:0], segment.size, segment.pts, segment.key, segment.end))

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:06d}.npz"


def _read(path: Path) -> Segment | None:
    """Read the part at ``path``; None if there is no usable one."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return Segment(arrays["data"], arrays["size"], arrays["pts"], arrays["key"], int(arrays["end"]))
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None
