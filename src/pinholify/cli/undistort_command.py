"""``pinholify undistort``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pinholify.cli.options import examples, json_option, overwrite_option, print_json, progress, say
from pinholify.cli.video import CODECS, straighten_one_video
from pinholify.cli.view_options import ViewChoice, view_json, view_options
from pinholify.errors import ImageError, OutputError

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.batch.jobs import Report
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
@click.option("-o", "output", required=True, help="Folder for the pictures, a path or a URL; a file for a video.")
@view_options
@click.option(
    "--method",
    type=click.Choice(["remap", "splat"]),
    default="remap",
    show_default=True,
    help="Interpolate backwards, or the paper's forward splat with a median filter, several times slower.",
)
@click.option("--codec", type=click.Choice(CODECS), help="Video: how to encode; as the original by default.")
@click.option("--quality", type=click.IntRange(0, 63), help="Video: constant rate factor, less is better.")
@click.option("--workers", type=click.IntRange(1), default=1, show_default=True, help="Processes to use.")
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of a dask cluster, e.g. tcp://127.0.0.1:8786.")
@click.option("--resume", is_flag=True, help="Skip what an earlier run with this camera and these options finished.")
@json_option
@overwrite_option
def command(
    camera: Path,
    images: tuple[str, ...],
    output: str,
    choice: ViewChoice,
    method: str,
    codec: str | None,
    quality: int | None,
    workers: int,
    scheduler: str | None,
    resume: bool,
    as_json: bool,
    force: bool,
) -> None:
    """Straighten IMAGES (files, folders or URLs) of CAMERA into a folder, as PNG or for a JPEG as JPEG; or one video.

    What the camera does not know is black, and clear where an image has alpha. It knows the part of the image where
    the standard deviation of its map is within its own limit, or --max-std. One of a single photograph knows the part
    that its corners cover, an imported one where its formula holds. An image that fails is reported and the rest are
    done; the exit status is then 1. A video keeps its frames' times and depth, its colours and its sound; when it is
    stopped, the same command goes on from there. --json tells the view's K and rotation.
    """
    from pinholify.batch.run import straighten_images
    from pinholify.io.places import image_places
    from pinholify.io.video.source import is_video

    if scheduler is not None and workers > 1:
        raise click.UsageError("give either --workers or --scheduler: a cluster knows its own workers")
    sources = image_places(images)
    videos = any(map(is_video, sources))
    if videos and (scheduler is not None or workers > 1):
        raise click.UsageError("--workers and --scheduler are for images; a video takes the cores it can use by itself")
    if not videos and (codec is not None or quality is not None):
        raise click.UsageError("--codec and --quality are for a video")
    if not videos:
        check_folder(output)
    straighten = choice.straightener(camera, method=method)
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
    """Raise OutputError for a place that is called like a file: nobody means a folder ``a.jpg``, unless it is one."""
    from pinholify.io.images import IMAGE_SUFFIXES
    from pinholify.io.video.encoding import CONTAINERS

    if Path(output).suffix.lower() in {*IMAGE_SUFFIXES, *CONTAINERS} and not Path(output).is_dir():
        raise OutputError(
            f"'{output}' is called like a file and pictures go into a folder, under their own names; give a folder"
        )


def to_json(report: Report, straightener: Straightener) -> dict[str, Any]:
    """The object that ``--json`` prints."""
    finished = {"finished_before": report.finished} if report.finished else {}
    return {
        "format_version": 1,
        "written": report.written,
        **finished,
        "failed": report.failed,
        "view": view_json(straightener),
    }


def say_what_was_written(report: Report, folder: str) -> None:
    """A line about the pictures, none where there are none."""
    before = f"; {len(report.finished)} were there already" if report.finished else ""
    if report.written or report.finished:
        count = len(report.written)
        click.echo(f"wrote {count} image{'' if count == 1 else 's'} into {folder}{before}")


def summary_of(failures: Mapping[str, str], total: int) -> str:
    """One sentence about images that failed; where there are several, all are listed before it."""
    if len(failures) > 1:
        for error in failures.values():
            say(error)
    first = next(iter(failures.values()))
    return first if total == 1 else f"{len(failures)} of {total} images could not be straightened: {first}"
