"""Reading a video file: its properties, and its frames in order, each with a distinct time."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from pinholify.errors import ImageError, InputError

VIDEO_SUFFIXES = frozenset(
    [".3gp", ".avi", ".m2ts", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".mxf", ".ts", ".webm", ".wmv"]
)

Frame = Any
"""PyAV's ``av.VideoFrame``."""


@dataclass(frozen=True, slots=True)
class Colour:
    """Colour description by the code points of ITU-T H.273; ``range`` is 1 (limited) or 2 (full)."""

    primaries: int
    transfer: int
    matrix: int
    range: int


@dataclass(frozen=True, slots=True)
class VideoInfo:
    """The picture stream of a video; ``size`` (width, height) px is that of the sensor, whatever the display rotation.

    Times are multiples of ``time_base`` s. ``rate`` (frames per second) and ``frames`` (their number) are what the file
    declares; they may be wrong or None. ``display_matrix`` holds the nine integers that rotate the picture for display.
    """

    codec: str
    size: tuple[int, int]
    pixel_format: str
    time_base: Fraction
    rate: Fraction | None
    frames: int | None
    colour: Colour
    display_matrix: tuple[int, ...] | None


def is_video(place: str) -> bool:
    """Whether ``place`` has the ending of a video file."""
    return Path(place).suffix.lower() in VIDEO_SUFFIXES


def pyav() -> Any:
    """The package ``av``; raises InputError if it is not installed."""
    try:
        return importlib.import_module("av")
    except ImportError:
        raise InputError("videos need PyAV, which is not installed: pip install 'pinholify[video]'") from None


@contextmanager
def opened(path: str) -> Iterator[tuple[Any, Any]]:
    """PyAV's container of the video ``path`` and its picture stream; raises ImageError if it is not a video.

    Decoding errors inside the block are converted to ImageError too.
    """
    av = pyav()
    try:
        with av.open(path) as container:
            streams = [s for s in container.streams.video if not s.disposition & av.stream.Disposition.attached_pic]
            if not streams:
                raise ImageError(f"'{path}' contains no video stream; give a video file")
            streams[0].thread_type = "AUTO"
            yield container, streams[0]
    except FileNotFoundError:
        raise ImageError(f"there is no file '{path}'; check the name") from None
    except av.error.FFmpegError as error:
        raise ImageError(
            f"'{path}' cannot be read as a video ({error.strerror}); it may be damaged: copy it again"
        ) from None


def probe(path: str) -> VideoInfo:
    """The properties of the video ``path``; raises ImageError if it is not a video, or interlaced."""
    with opened(path) as (container, stream):
        frame = next(container.decode(stream), None)
        if frame is None:
            raise ImageError(f"'{path}' contains no frame; it may be cut short or damaged")
        if frame.interlaced_frame:
            raise ImageError(
                f"'{path}' is interlaced, so every frame mixes two instants; deinterlace it first: ffmpeg -vf bwdif"
            )
        return VideoInfo(
            stream.codec_context.codec.canonical_name,
            (frame.width, frame.height),
            frame.format.name,
            stream.time_base,
            stream.average_rate or stream.guessed_rate,
            stream.frames or _frames_by_duration(container, stream),
            _colour_of(frame),
            _display_matrix(frame),
        )


def _frames_by_duration(container: Any, stream: Any) -> int | None:
    rate, seconds = stream.average_rate, container.duration and container.duration / 1e6
    return round(rate * Fraction(seconds)) if rate and seconds else None


def _colour_of(frame: Frame) -> Colour:
    # The formats yuvj… are the deprecated way to declare full range.
    full = 2 if frame.format.name.startswith("yuvj") else int(frame.color_range)
    return Colour(int(frame.color_primaries), int(frame.color_trc), int(frame.colorspace), full)


def _display_matrix(frame: Frame) -> tuple[int, ...] | None:
    from av.sidedata.sidedata import Type

    data = frame.side_data.get(Type.DISPLAYMATRIX)
    return None if data is None else tuple(memoryview(bytes(data)).cast("i"))


def frames(path: str, *, after: int | None = None) -> Iterator[Frame]:
    """Yield the frames of the video ``path`` in order, only those later than ``after`` (the time of a frame) if given.

    Times increase strictly: a frame without a time, or not later than the last one, gets the next suitable time. A file
    that is cut short just ends earlier: see :func:`pinholify.io.video.completeness.shortfall`. Raises ImageError if the
    file is damaged or its frames change in size or format.
    """
    found = None if after is None else _sought(path, after)
    yield from found if found is not None else _later(path, after)


def _later(path: str, after: int | None) -> Iterator[Frame]:
    return (frame for frame in _timed(path, None) if after is None or frame.pts > after)


def _sought(path: str, after: int) -> Iterator[Frame] | None:
    """The frames later than ``after`` without decoding all earlier ones; None if seeking does not find that frame."""
    sought = _timed(path, after)
    for frame in sought:
        if frame.pts >= after:
            return sought if frame.pts == after else None
    return None


def _timed(path: str, sought: int | None) -> Iterator[Frame]:
    """All frames with times, from the key frame at or before the time ``sought``."""
    with opened(path) as (container, stream):
        if sought is not None:
            container.seek(sought, stream=stream)
        rate = stream.average_rate or stream.guessed_rate or Fraction(25)
        step, last, kind = max(round(1 / (rate * stream.time_base)), 1), None, None
        for frame in _decoded(container, stream):
            if kind not in (None, (frame.width, frame.height, frame.format.name)):
                raise ImageError(f"'{path}' changes its size or format at {frame.time} s; split it there first")
            kind = (frame.width, frame.height, frame.format.name)
            if frame.pts is None:
                if sought is not None:  # it is unknown which frame this is
                    return
                frame.pts = 0 if last is None else last + step
            elif last is not None and frame.pts <= last:
                frame.pts = last + 1
            last = frame.pts
            yield frame


def _decoded(container: Any, stream: Any) -> Iterator[Frame]:
    for packet in container.demux(stream):
        try:
            yield from packet.decode()
        except pyav().error.InvalidDataError:
            if not packet.is_corrupt:  # a corrupt packet is the last one of a file that is cut short
                raise
