"""A finished video: encoded parts as its picture; sound, subtitles, chapters and texts copied from the original."""

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
WRITTEN_ANEW = ("major_brand", "minor_version", "compatible_brands", "encoder")
"""Texts that describe the file and not what is in it."""


def left_out(path: str) -> list[str]:
    """The kinds of the streams of the video ``path`` that no straightened one has."""
    with opened(path) as (container, picture):
        return [s.type for s in container.streams if s.index != picture.index and s.type not in COPIED]


def try_container(source: str, temporary: Path, encoding: Encoding, info: VideoInfo) -> None:
    """Raise OutputError where the file called ``temporary`` would not hold what :func:`assemble` puts in; it does not
    survive this.
    """
    with opened(source) as (original, _):
        output, _, _ = _started(original, temporary, encoding, info)
        output.close()


def assemble(source: str, temporary: Path, encoding: Encoding, info: VideoInfo, parts: SegmentFolder) -> None:
    """Write the video ``parts`` of the original ``source`` at ``temporary``, its streams side by side in time.

    Nothing is encoded. Raises OutputError where the container does not take it, ImageError for a damaged original.
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
    """The new file with its header written, its picture's stream, and a copy for each stream that is copied."""
    av = pyav()
    try:
        output = av.open(str(temporary), "w", container_options=_exact_starts(temporary, info))
        picture = output.add_stream(encoding.encoder)
        encoding.configure(picture.codec_context)
        picture.time_base = info.time_base
        if info.display_matrix is not None:
            picture.set_display_matrix(list(info.display_matrix))
        copies = {s.index: _copy(output, s) for s in original.streams if s.type in COPIED}
        output.metadata.update({k: v for k, v in original.metadata.items() if k not in WRITTEN_ANEW})
        output.set_chapters(original.chapters())
        output.start_encoding()
    except (av.error.FFmpegError, ValueError) as error:
        raise OutputError(
            f"a {temporary.suffix} file does not take what is in this video ({error}); name the result .mkv"
        ) from None
    return output, picture, copies


def _exact_starts(path: Path, info: VideoInfo) -> dict[str, str]:
    """MP4 and QuickTime files begin a stream later by a time of the movie's own scale, of milliseconds by default."""
    return {} if path.suffix.lower() in (".mkv", ".webm") else {"movie_timescale": str(info.time_base.denominator)}


def _copy(output: Any, stream: Any) -> Any:
    copy = output.add_stream_from_template(stream)
    copy.metadata.update(stream.metadata)
    copy.disposition = stream.disposition
    return copy


def _picture_packets(stream: Any, parts: SegmentFolder, info: VideoInfo) -> Iterator[tuple[float, Any]]:
    """The packets of all parts with their times of decoding in s."""
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
    """When each packet is decoded, and how long the frame of each time is shown.

    Every part was encoded as if nothing came before it. Here the times of all frames, sorted, are the times of
    decoding, moved back by as many frames as packets come early at most.
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
    """The packets of the streams that are copied, with their times in s."""
    time = 0.0
    for packet in original.demux([original.streams[index] for index in copies]):
        if packet.size == 0 and packet.dts is None:  # PyAV's sign for the end
            continue
        if packet.dts is not None:
            time = float(packet.dts * packet.time_base)
        packet.stream = copies[packet.stream_index]
        yield time, packet
