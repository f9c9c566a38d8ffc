"""Assembly of a video from its encoded parts, with sound, subtitles, chapters and metadata of the original."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pinholify.arrays import Ints
from pinholify.errors import OutputError
from pinholify.io.video.encoding import Encoding
from pinholify.io.video.segments import SegmentFolder
from pinholify.io.video.source import VideoInfo, opened, pyav

COPIED = ("audio", "subtitle")
NOT_COPIED = ("major_brand", "minor_version", "compatible_brands", "encoder")
"""Metadata that describes the container and not its content."""


def left_out(path: str) -> list[str]:
    """The types of the streams of the video ``path`` that the straightened video will lack."""
    with opened(path) as (container, picture):
        return [s.type for s in container.streams if s.index != picture.index and s.type not in COPIED]


def try_container(source: str, temporary: Path, encoding: Encoding, info: VideoInfo) -> None:
    """Raise OutputError if the container of ``temporary`` cannot hold the result of :func:`assemble`; overwrites it."""
    with opened(source) as (original, _):
        output, _, _ = _started(original, temporary, encoding, info)
        output.close()


def assemble(source: str, temporary: Path, encoding: Encoding, info: VideoInfo, parts: SegmentFolder) -> None:
    """Write the video ``parts`` of the original ``source`` to ``temporary``, with all streams interleaved in time.

    Nothing is encoded. Raises OutputError if the container does not support it, and ImageError for a damaged original.
    """
    with opened(source) as (original, _):
        output, picture, copies = _started(original, temporary, encoding, info)
        with output:
            streams = [_picture_packets(picture, parts, info)]
            if copies:
                streams.append(_copied_packets(original, copies))
            for _, packet in heapq.merge(*streams, key=lambda timed: timed[0]):
                output.mux(packet)


def _started(original: Any, temporary: Path, encoding: Encoding, info: VideoInfo) -> tuple[Any, Any, dict[int, Any]]:
    """The output container with its header written, its picture stream, and a stream for each one that is copied."""
    av = pyav()
    try:
        output = av.open(str(temporary), "w", container_options=_exact_starts(temporary, info))
        picture = output.add_stream(encoding.encoder)
        encoding.configure(picture.codec_context)
        picture.time_base = info.time_base
        if info.display_matrix is not None:
            picture.set_display_matrix(list(info.display_matrix))
        copies = {s.index: _copy(output, s) for s in original.streams if s.type in COPIED}
        output.metadata.update({k: v for k, v in original.metadata.items() if k not in NOT_COPIED})
        output.set_chapters(original.chapters())
        output.start_encoding()
    except (av.error.FFmpegError, ValueError) as error:
        raise OutputError(
            f"a {temporary.suffix} file cannot hold the streams of this video ({error}); name the result .mkv"
        ) from None
    return output, picture, copies


def _exact_starts(path: Path, info: VideoInfo) -> dict[str, str]:
    """The option that makes MP4 and QuickTime store start times exactly, and not in the default milliseconds."""
    return {} if path.suffix.lower() in (".mkv", ".webm") else {"movie_timescale": str(info.time_base.denominator)}


def _copy(output: Any, stream: Any) -> Any:
    copy = output.add_stream_from_template(stream)
    copy.metadata.update(stream.metadata)
    copy.disposition = stream.disposition
    return copy


def _picture_packets(stream: Any, parts: SegmentFolder, info: VideoInfo) -> Iterator[tuple[float, Any]]:
    """The packets of all parts with their decoding times in s."""
    av = pyav()
    dts, durations = _times(parts)
    number = 0
    for segment in parts:
        start = 0
        for size, pts, key in zip(segment.size.tolist(), segment.pts.tolist(), segment.key.tolist(), strict=True):
            packet = av.Packet(segment.data[start : start + size].tobytes())
            packet.stream, packet.time_base = stream, info.time_base
            packet.pts, packet.dts, packet.duration = pts, int(dts[number]), durations[pts]
            packet.is_keyframe = key
            start, number = start + size, number + 1
            yield float(packet.dts * info.time_base), packet


def _times(parts: SegmentFolder) -> tuple[Ints, dict[int, int]]:
    """The decoding time of each packet, and presentation time → duration of each frame.

    Each part was encoded as if it were the first. The decoding times of the whole are the sorted presentation times,
    shifted back by the largest number of frames that a packet precedes its presentation order.
    """
    pts = np.concatenate([segment.pts for segment in parts.index])
    shown = np.sort(pts)
    early = int((np.arange(len(pts)) - np.searchsorted(shown, pts)).max())
    step = int(shown[1] - shown[0]) if len(shown) > 1 else 1
    before = shown[0] - step * np.arange(early, 0, -1)
    dts = np.concatenate([before, shown])[: len(pts)]
    lengths = np.diff(shown, append=max(parts.index[-1].end, shown[-1]))
    return dts, dict(zip(shown.tolist(), lengths.tolist(), strict=True))


def _copied_packets(original: Any, copies: dict[int, Any]) -> Iterator[tuple[float, Any]]:
    """The packets of the copied streams with their decoding times in s."""
    time = 0.0
    for packet in original.demux([original.streams[index] for index in copies]):
        if packet.size == 0 and packet.dts is None:  # PyAV's mark of the end
            continue
        if packet.dts is not None:
            time = float(packet.dts * packet.time_base)
        packet.stream = copies[packet.stream_index]
        yield time, packet
