"""Straightening a video: decoding, remapping and encoding in parallel; a stopped run can be resumed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from pinholify.batch.ahead import ahead
from pinholify.batch.straightening import straightening
from pinholify.errors import ImageError, InputError, OutputError
from pinholify.io.files import atomic_path
from pinholify.io.video.assembly import assemble, left_out, try_container
from pinholify.io.video.encoders import CONTAINERS
from pinholify.io.video.encoding import Encoding, choose_encoding
from pinholify.io.video.planes import FULL_RANGE, frame_straightener
from pinholify.io.video.segments import SegmentFolder, encode
from pinholify.io.video.source import Frame, VideoInfo, frames, probe, pyav
from pinholify.rectification.maps import rectification_map
from pinholify.rectification.straightener import Straightener

SEGMENT = 600
"""Frames per part: the most that is lost when a run is stopped."""


@dataclass(frozen=True, slots=True)
class VideoJob:
    """A video to straighten that has been checked; ``left_out`` are the kinds of streams that will be missing.

    ``parts`` is the folder of encoded parts until all are finished; its name contains a digest of the source, the
    camera, the view and the encoding.
    """

    source: str
    target: str
    info: VideoInfo
    encoding: Encoding
    parts: Path
    left_out: tuple[str, ...]


def video_job(
    straightener: Straightener, source: str, target: str, *, codec: str | None = None, quality: int | None = None
) -> VideoJob:
    """Plan the straightening of the video ``source`` to ``target``; ``codec`` and ``quality`` as ``choose_encoding``.

    Raises ImageError for a video that is not the camera's, InputError for incompatible options, and OutputError if the
    target cannot be written or its container does not support the streams.
    """
    if Path(target).suffix.lower() not in CONTAINERS:
        raise OutputError(f"'{target}' is not a supported video; end its name in one of {', '.join(CONTAINERS)}")
    if straightener.method != "remap":
        raise InputError(f"videos are straightened by 'remap' only, not by '{straightener.method}'")
    info = probe(source)
    if info.size != straightener.camera.image_size:
        raise ImageError(
            f"'{source}' is {info.size[0]}x{info.size[1]} and the camera was calibrated at "
            f"{straightener.camera.image_size[0]}x{straightener.camera.image_size[1]}: give a video of that size, "
            "or make the camera of this mode with 'pinholify mode'"
        )
    encoding = choose_encoding(info, straightener.view.size, codec=codec, quality=quality)
    _try(source, target, encoding, info)
    parts = Path(f"{target}.parts-{_identity(straightener, source, encoding)}")
    return VideoJob(source, target, info, encoding, parts, tuple(left_out(source)))


class _Tried(Exception):
    """Ends a trial of a container."""


def _try(source: str, target: str, encoding: Encoding, info: VideoInfo) -> None:
    try:
        with atomic_path(target) as temporary:
            try_container(source, temporary, encoding, info)
            raise _Tried
    except _Tried:
        return


def _identity(straightener: Straightener, source: str, encoding: Encoding) -> str:
    """A digest that identifies the parts of this video."""
    stat = os.stat(source)
    stamp = straightening(straightener).stamp(source, stat.st_size)
    text = f"{stamp} {stat.st_mtime_ns} {encoding} {pyav().__version__}"
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def straighten_video(straightener: Straightener, job: VideoJob, *, on_frame: Callable[[], object] | None = None) -> int:
    """Do ``job`` and return the number of frames; ``on_frame`` is called for each, also for those of an earlier run.

    Every frame keeps its time and bit depth, and the sound is copied. Finished parts stay next to the target until it
    is complete, so that the same call resumes a stopped run. Raises ImageError if the video is damaged, OutputError if
    a file cannot be written.
    """
    parts = SegmentFolder(job.parts)
    for _ in range(parts.frames if on_frame else 0):
        on_frame()  # type: ignore[misc]
    straight = _straight_frames(straightener, job, parts.last)
    try:
        while (segment := encode(job.encoding, _counted(islice(straight, SEGMENT), on_frame))) is not None:
            parts.add(segment)
    finally:
        straight.close()
    with atomic_path(job.target) as temporary:
        assemble(job.source, temporary, job.encoding, job.info, parts)
    parts.remove()
    return parts.frames


def _straight_frames(straightener: Straightener, job: VideoJob, after: int | None) -> Generator[Frame, None, None]:
    """The frames after the time ``after``, decoded in one thread and remapped in another."""
    rectification = rectification_map(straightener.camera, straightener.view, max_std=straightener.options.max_std)
    straighten = frame_straightener(
        rectification, job.info.size, job.encoding.pixel_format, full_range=job.encoding.colour.range == FULL_RANGE
    )
    decoded = ahead(frames(job.source, after=after))
    yield from ahead(straighten(_in_format(frame, job.encoding)) for frame in decoded)


def _in_format(frame: Frame, encoding: Encoding) -> Frame:
    """``frame`` converted to the pixel format of ``encoding``; unchanged if it already has that."""
    if frame.format.name.replace("yuvj", "yuv") == encoding.pixel_format:
        return frame
    # BT.709, as the encoding declares for RGB sources; it has no effect between YUV formats.
    return frame.reformat(format=encoding.pixel_format, dst_colorspace="ITU709" if frame.format.is_rgb else None)


def _counted(some: Iterator[Frame], on_frame: Callable[[], object] | None) -> Iterator[Frame]:
    for frame in some:
        if on_frame is not None:
            on_frame()
        yield frame
