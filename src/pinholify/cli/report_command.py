"""The command ``pinholify report``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli.options import check_output, examples, explained, force_option, json_option, progress, say
from pinholify.cli.stills import stills_for_videos
from pinholify.report.formats import FORMATS, is_report, render, write_report

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.calibration.result import Calibration
    from pinholify.evaluation.summary import Evaluation
    from pinholify.evaluation.verdict import Verdict
    from pinholify.report.contents import Report
    from pinholify.report.photographs import Photographs

STANDARD_OUTPUT = Path("-")


@click.command(
    "report",
    epilog=examples(
        "pinholify report camera.npz photos/ -o report.html",
        "pinholify report camera.npz --format md -o ticket.md",
    ),
)
@click.argument("camera", type=click.Path(path_type=Path))
@click.argument("images", nargs=-1, type=click.Path(path_type=Path))
@click.option("-o", "output", type=click.Path(path_type=Path),
              help="File to write; report.html by default (or .md, .json); - is standard output.")
@click.option("--format", "form", type=click.Choice(list(FORMATS)),
              help=explained(FORMATS) + " Default: as -o ends.")
@click.option("--opencv/--no-opencv", default=True, show_default=True, help="Fit OpenCV's models to compare with.")
@click.option("--heldout/--no-heldout", default=True, show_default=True,
              help="Calibrate again on half of the boards to score the others.")
@json_option
@force_option
def command(
    camera: Path,
    images: tuple[Path, ...],
    output: Path | None,
    form: str | None,
    opencv: bool,
    heldout: bool,
    as_json: bool,
    force: bool,
) -> None:
    """Write a self-contained report on how good CAMERA is.

    IMAGES (files, folders, videos) are the photographs it was made from, optionally with another one of the same camera
    to show straightened. Without IMAGES, the photographs are looked for next to the camera file and in the current
    folder. With --json the report's numbers go to standard output, and a file is written only if -o names one.
    """
    from pinholify.io.camera_file import read_camera
    from pinholify.report.evaluated import evaluated

    if output == STANDARD_OUTPUT and as_json:
        raise click.UsageError("--json and -o - both write to standard output; omit one")
    path = output or Path(f"report.{form or 'html'}")
    if output or not as_json:
        check_report_output(path, (camera, *images), form, force=force)
    calibration = read_camera(camera)
    evaluation, verdict = evaluated(calibration, opencv=opencv, heldout=heldout)
    report = gathered_report(evaluation, verdict, images, camera)
    if output or not as_json:
        write_to(path, report, form, aloud=not as_json)
    if as_json:
        click.echo(render(report, "json"), nl=False)


def write_to(path: Path, report: Report, form: str | None = None, *, aloud: bool) -> None:
    """Write ``report`` as ``form``, by default the format of the ending of ``path``; ``aloud`` also prints messages."""
    ending = path.suffix.lower().removeprefix(".")
    form = form or (ending if ending in FORMATS else "html")
    if path == STANDARD_OUTPUT:
        click.echo(render(report, form), nl=False)
    else:
        write_report(path, report, form)
    if aloud:
        for sentence in report.missing:
            say(f"note: {sentence}")
        if path != STANDARD_OUTPUT:
            click.echo(f"wrote {path}")


def check_report_output(path: Path, inputs: Sequence[Path], form: str | None = None, *, force: bool) -> None:
    """Raise OutputError if the report must not be written to ``path``; inputs are protected even before they exist."""
    from pinholify.errors import OutputError

    if path == STANDARD_OUTPUT:
        return
    if path.absolute() in [source.absolute() for source in inputs]:
        raise OutputError(f"the report '{path}' would replace another file of this command; choose another name")
    ending = path.suffix.lower().removeprefix(".")
    if form is None and ending and ending not in FORMATS:
        raise OutputError(
            f"'{path}' ends in .{ending}, which is not a format of reports: choose a name that ends in "
            f"{' or '.join('.' + name for name in FORMATS)}"
        )
    check_output(path, force=force, is_ours=is_report, inputs=inputs)


def gathered_report(evaluation: Evaluation, verdict: Verdict, images: Sequence[Path], camera: Path) -> Report:
    """Make the report of an evaluated ``camera`` file, with photographs from ``images`` or else from near that file."""
    from pinholify.report.contents import make_report
    from pinholify.report.pictures import read_pictures
    from pinholify.report.provenance import provenance_of

    calibration = evaluation.calibration
    with photographs_of(calibration, images, camera) as found:
        with progress("Reading photographs", len(found.by_name)) as advance:
            pictures = read_pictures(calibration, found.by_name, found.others, on_read=advance)
        return make_report(evaluation, verdict, provenance_of(camera), pictures)


@contextmanager
def photographs_of(calibration: Calibration, images: Sequence[Path], camera: Path) -> Iterator[Photographs]:
    """Find the camera's photographs in ``images``, or near its file; frames of videos exist only within the block."""
    from pinholify.io.images import image_paths
    from pinholify.report.photographs import matched, nearby

    names = [view.name for view in calibration.corner_set.views]
    if not images:
        yield nearby(names, (camera.absolute().parent, Path()))
        return
    with stills_for_videos(image_paths(images)) as files:
        yield matched(names, files)
