"""The command ``pinholify undistort``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pinholify.cli.options import examples, explained, json_option, overwrite_option, print_json, progress, say
from pinholify.cli.video import straighten_one_video
from pinholify.cli.view_options import straightener_of, view_json, view_options
from pinholify.errors import ImageError, OutputError
from pinholify.io.video.encoders import CONTAINERS, ENCODERS
from pinholify.rectification.options import METHODS, ViewOptions

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.batch.jobs import BatchReport
    from pinholify.rectification.straightener import Straightener


EXAMPLES = examples(
    "pinholify undistort camera.npz photos/*.jpg -o straight/ --max-std 1",
    "pinholify undistort camera.npz photos/ -o straight/ --keep valid",
    "pinholify undistort fisheye.npz photos/ -o around/ --view equirectangular",
    "pinholify undistort camera.npz in.mp4 -o out.mp4",
)


@click.command("undistort", epilog=EXAMPLES)
@click.argument("camera", type=click.Path(path_type=Path))
@click.argument("images", nargs=-1, required=True)
@click.option("-o", "output", required=True, help="Folder for the pictures, as a path or URL; for a video, a file.")
@view_options
@click.option(
    "--method",
    type=click.Choice(list(METHODS)),
    default="remap",
    show_default=True,
    help=explained(METHODS),
)
@click.option(
    "--codec", type=click.Choice(list(ENCODERS)), help="Video: codec of the output; by default that of the original."
)
@click.option("--quality", type=click.IntRange(0, 63), help="Video: constant rate factor; lower is better.")
@click.option("--workers", type=click.IntRange(1), default=1, show_default=True, help="Number of processes.")
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of a Dask cluster, e.g. tcp://127.0.0.1:8786.")
@click.option("--resume", is_flag=True, help="Skip what an earlier run with this camera and these options finished.")
@json_option
@overwrite_option
def command(
    camera: Path,
    images: tuple[str, ...],
    output: str,
    view: ViewOptions,
    method: str,
    codec: str | None,
    quality: int | None,
    workers: int,
    scheduler: str | None,
    resume: bool,
    as_json: bool,
    force: bool,
) -> None:
    """Straighten IMAGES (files, folders or URLs) of CAMERA into a folder, as PNG (JPEG for JPEG input); or one video.

    Pixels that the camera does not know are black, and transparent in an image with alpha. Known is where the standard
    deviation of the map is within the camera's own limit, or --max-std; for a camera of a single photograph where its
    corners are, for an imported one where its formula holds. An image that fails is reported and the rest are
    processed; the exit status is then 1. A video keeps its frame times, bit depth, colours and sound; if a run is
    stopped, the same command continues it. --json prints the view's K and rotation.
    """
    from pinholify.batch.run import straighten_images
    from pinholify.io.places import image_places
    from pinholify.io.video.source import is_video

    if scheduler is not None and workers > 1:
        raise click.UsageError("give either --workers or --scheduler: a cluster has its own workers")
    sources = image_places(images)
    videos = any(map(is_video, sources))
    if videos and (scheduler is not None or workers > 1):
        raise click.UsageError("--workers and --scheduler are for images; a video uses the available cores by itself")
    if not videos and (codec is not None or quality is not None):
        raise click.UsageError("--codec and --quality are for videos")
    if not videos:
        check_folder(output)
    straighten = straightener_of(camera, view, method)
    if videos:
        straighten_one_video(straighten, sources, output, codec=codec, quality=quality, force=force, as_json=as_json)
        return
    with progress("Straightening", len(sources)) as advance:
        report = straighten_images(
            straighten, sources, output, workers=workers, scheduler=scheduler, resume=resume, force=force,
            on_outcome=lambda _: advance(),
        )  # fmt: skip
    if as_json:
        print_json(to_json(report, straighten))
    else:
        say_what_was_written(report, output)
    if report.failed:
        raise ImageError(summary_of(report.failed, len(report.written) + len(report.failed)))


def check_folder(output: str) -> None:
    """Raise OutputError if ``output`` has the ending of an image or video and is not an existing folder."""
    from pinholify.io.images import IMAGE_SUFFIXES

    if Path(output).suffix.lower() in {*IMAGE_SUFFIXES, *CONTAINERS} and not Path(output).is_dir():
        raise OutputError(
            f"'{output}' looks like a file name, but pictures keep their own names: give a folder to write them into"
        )


def to_json(report: BatchReport, straightener: Straightener) -> dict[str, Any]:
    """The object that ``--json`` prints."""
    finished = {"finished_before": report.finished} if report.finished else {}
    return {
        "format_version": 1,
        "written": report.written,
        **finished,
        "failed": report.failed,
        "view": view_json(straightener),
    }


def say_what_was_written(report: BatchReport, folder: str) -> None:
    """Print how many pictures were written, if any."""
    before = f"; {len(report.finished)} were already there" if report.finished else ""
    if report.written or report.finished:
        count = len(report.written)
        click.echo(f"wrote {count} image{'' if count == 1 else 's'} into {folder}{before}")


def summary_of(failures: Mapping[str, str], total: int) -> str:
    """One sentence about the images that failed; if there are several, each is reported first."""
    if len(failures) > 1:
        for error in failures.values():
            say(error)
    first = next(iter(failures.values()))
    return first if total == 1 else f"{len(failures)} of {total} images could not be straightened: {first}"
