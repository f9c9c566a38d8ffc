"""Straightening a video, for ``pinholify undistort``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pinholify.cli.options import check_output, print_json, progress, say
from pinholify.cli.view_options import view_json
from pinholify.errors import ImageError, InputError

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.batch.video import VideoJob
    from pinholify.rectification.straightener import Straightener


def straighten_one_video(
    straightener: Straightener,
    sources: Sequence[str],
    target: str,
    *,
    codec: str | None,
    quality: int | None,
    force: bool,
    as_json: bool,
) -> None:
    """Straighten the single video in ``sources`` into the file ``target``, and report it.

    A video that is cut short is written as far as it goes, and then raises ImageError.
    """
    from pinholify.batch.video import straighten_video, video_job
    from pinholify.io.places import is_url
    from pinholify.io.video.completeness import shortfall

    if len(sources) > 1:
        raise InputError(f"{len(sources)} files were given where one video was expected; straighten each by itself")
    source = sources[0]
    if is_url(source) or is_url(target):
        raise InputError("videos are read and written on this machine only; copy the video here first")
    check_output(Path(target), force=force, inputs=[source])
    job = video_job(straightener, source, target, codec=codec, quality=quality)
    _say_what_changes(job)
    with progress("Straightening", job.info.frames) as advance:
        try:
            frames = straighten_video(straightener, job, on_frame=advance)
        except KeyboardInterrupt:
            if job.parts.exists():
                say("stopped; run the same command to continue: what is done so far is kept in " + job.parts.name)
            raise
    lacking = shortfall(source)
    failure = "" if lacking is None else replace(lacking, found=frames).of(source)
    if as_json:
        print_json(to_json(job, frames, straightener, failure))
    else:
        click.echo(f"wrote {target}: {frames} frames")
    if failure:
        raise ImageError(failure)


def to_json(job: VideoJob, frames: int, straightener: Straightener, failure: str) -> dict[str, Any]:
    """The object that ``--json`` prints; ``failure`` says what the source lacks; empty if nothing."""
    return {
        "format_version": 1,
        "written": [job.target],
        "failed": {job.source: failure} if failure else {},
        "frames": frames,
        "encoder": job.encoding.encoder,
        "pixel_format": job.encoding.pixel_format,
        "left_out": job.left_out,
        "view": view_json(straightener),
    }


def _say_what_changes(job: VideoJob) -> None:
    """Report a pixel format that differs from the original's, and streams that are left out."""
    original = job.info.pixel_format.replace("yuvj", "yuv")
    if job.encoding.pixel_format != original:
        say(f"the pixel format is {job.encoding.pixel_format}: {job.encoding.encoder} does not support {original} here")
    if job.left_out:
        say(f"left out: {len(job.left_out)} streams ({', '.join(sorted(set(job.left_out)))})")
