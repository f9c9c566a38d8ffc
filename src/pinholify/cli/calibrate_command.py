"""``pinholify calibrate``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli import options
from pinholify.cli.options import (
    Auto,
    board_option,
    check_camera_output,
    examples,
    force_option,
    json_option,
    print_json,
    say,
)
from pinholify.cli.report_command import STANDARD_OUTPUT, check_report_output, gathered_report, write_to
from pinholify.cli.sources import gather_corners, input_files, look_again_with_progress, solving

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.board import Board
    from pinholify.calibration.result import Calibration

METHODS = ("auto", "joint", "one-image")
FEWEST_BOARDS = 3  # the reference and two that stand otherwise


@click.command(
    "calibrate",
    epilog=examples(
        "pinholify calibrate photos/ --board 15x9 --square 25mm -o camera.npz",
        "pinholify calibrate photos/ --board auto",
        "pinholify calibrate photos/ --board 15x9 --start last-month.npz",
        "pinholify calibrate --corners corners.vnl --image-size 3840x2160 --board 15x9",
    ),
)
@click.argument("images", nargs=-1, type=click.Path(path_type=Path))
@board_option
@click.option("-o", "output", type=click.Path(path_type=Path), default="camera.npz", show_default=True,
              help="Camera file to write.")
@click.option("--corners", "table", metavar="FILE", help="Take corners from a table (.vnl) instead of photographs.")
@click.option("--image-size", type=options.size, metavar="WxH", help="Size of the images in px; goes with --corners.")
@click.option("--square", "square_mm", type=options.length, help="Side of a square, e.g. 25mm.")
@click.option("--reference", metavar="IMAGE", help="Image whose board fixes the frame; by default the largest board.")
@click.option("--method", type=click.Choice(METHODS), default="auto", show_default=True,
              help="joint: all boards make the map; one-image: the reference alone; auto: joint from four boards on.")
@click.option("--kernel", default="se", show_default=True, help="se, ard-se, matern32, matern52 or rq.")
@click.option(
    "--trend",
    default="auto",
    show_default=True,
    help="auto: by evidence. One image: constant (the paper's), homography, lens[:order], polynomial[:order]. "
    "Joint: plane[:order], angle[:order], polynomial[:order], plane-d, angle-d.",
)
@click.option("--refine-corners", is_flag=True,
              help="Look again at the photographs once the camera is known, for finer and more corners.")
@click.option("--mirrored", is_flag=True, help="The camera looks into a mirror: the image is a reflection.")
@click.option("--start", type=click.Path(path_type=Path), metavar="FILE",
              help="A camera that is roughly this one, last month's or an imported one, to begin with; for joint.")
@click.option("--opencv/--no-opencv", default=True, show_default=True, help="Fit OpenCV's models to compare with.")
@click.option("--heldout/--no-heldout", default=True, show_default=True,
              help="Calibrate again on half of the boards to score the others.")
@click.option("--report", type=click.Path(path_type=Path), metavar="FILE",
              help="Also write a report for people: FILE ends in .html (one page with everything in it), .md or .json.")
@json_option
@force_option
def command(
    images: tuple[Path, ...],
    board: Board | Auto,
    output: Path,
    table: str | None,
    image_size: tuple[int, int] | None,
    square_mm: float | None,
    reference: str | None,
    method: str,
    kernel: str,
    trend: str,
    refine_corners: bool,
    mirrored: bool,
    start: Path | None,
    opencv: bool,
    heldout: bool,
    report: Path | None,
    as_json: bool,
    force: bool,
) -> None:
    """Make a perfect pinhole camera from photographs of a board (IMAGES: files, folders, videos) or a corner table.

    The reference's board fixes the frame and, with --method one-image, makes the camera by itself; the others then
    only tell its focal length and principal point. EXIF rotation is ignored: a calibration belongs to the sensor.
    """
    from pinholify.cli.report import print_evaluation, to_json
    from pinholify.evaluation.summary import evaluate
    from pinholify.evaluation.verdict import judge
    from pinholify.io.camera_file import read_camera, write_camera
    from pinholify.pipeline import calibrate

    method = chosen_method(method, kernel, trend)
    if refine_corners and table is not None:
        raise click.UsageError("--refine-corners looks at photographs; a corner table has none")
    if start is not None and method == "one-image":
        raise click.UsageError("the one-image method needs no --start: leave it out, or choose --method joint")
    files = input_files(images, table)
    inputs = files if start is None else [*files, start]
    check_camera_output(output, force=force, inputs=inputs)
    if report == STANDARD_OUTPUT:
        raise click.UsageError("--report needs the name of a file: standard output has the evaluation")
    if report is not None:
        check_report_output(report, (*inputs, output), force=force)
    known = None if start is None else read_camera(start).camera
    mirrored = mirrored or (known is not None and known.mirrored)
    corner_set = gather_corners(images, table, board, image_size, mirrored, needed=FEWEST_BOARDS)
    again = partial(calibrate, method=method, kernel=kernel, trend=trend, mirrored=mirrored, start=known)
    with solving():
        calibration = again(corner_set, reference=reference, square_mm=square_mm)
        if refine_corners:
            corner_set = look_again_with_progress(files, corner_set, calibration.camera)
            calibration = again(corner_set, reference=calibration.reference, square_mm=square_mm)
    again = partial(again, method=calibration.method)
    with keeping(calibration, output):
        evaluation = evaluate(
            calibration,
            corner_set,
            recalibrate=(lambda part, name: again(part, reference=name)) if heldout else None,
            compare_opencv=opencv,
        )
        verdict = judge(evaluation, corner_set)
    write_camera(output, calibration)
    if calibration.details.get("start_fits") is False:
        say(f"'{start}' was left aside as a start, it does not explain the corners: is it this camera, in this mode?")
    if as_json:
        print_json(to_json(evaluation, verdict))
    else:
        print_evaluation(evaluation, verdict)
        click.echo(f"wrote {output}")
    if report is not None:
        write_to(report, gathered_report(evaluation, verdict, images, output), aloud=not as_json)


@contextmanager
def keeping(calibration: Calibration, output: Path) -> Iterator[None]:
    """Where equations of an evaluation, inside the block, have no solution, writes the camera before it says so."""
    import numpy as np

    from pinholify.errors import CalibrationError
    from pinholify.io.camera_file import write_camera

    try:
        yield
    except np.linalg.LinAlgError as error:
        write_camera(output, calibration)
        raise CalibrationError(
            f"wrote {output}, but not how good it is: its evaluation leads to equations without a solution ({error}); "
            f"try it on other photographs with 'pinholify evaluate {output}'"
        ) from None


def chosen_method(method: str, kernel: str, trend: str) -> str:
    """``method``, or for ``auto`` the only one that knows ``kernel`` and ``trend``; a usage error where none does."""
    reasons = {name: _unknown(name, kernel, trend) for name in METHODS if method in ("auto", name) and name != "auto"}
    able = [name for name, reason in reasons.items() if not reason]
    if not able:
        raise click.UsageError("; ".join(reasons.values()))
    return able[0] if len(able) == 1 else method


def _unknown(method: str, kernel: str, trend: str) -> str:
    """What ``method`` says where it does not know ``kernel`` or ``trend``, else nothing."""
    from pinholify.errors import InputError
    from pinholify.gp.kernels import kernel_named
    from pinholify.gp.trends import trends_named
    from pinholify.refinement.spectral import density_named
    from pinholify.refinement.trends import searches_named

    try:
        if method == "joint":
            density_named(kernel)
            searches_named(trend)
        else:
            kernel_named(kernel)
            if trend != "constant":
                trends_named(trend)
    except InputError as error:
        return str(error)
    return ""
