"""The command ``pinholify calibrate``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.calibration.methods import FEWEST_BOARDS, METHODS
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
from pinholify.cli.sources import gather_corners, input_files, look_again_with_progress

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.board import Board
    from pinholify.calibration.result import Calibration



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
@click.option("--image-size", type=options.size, metavar="WxH", help="Size of the images in px; with --corners.")
@click.option("--square", "square_mm", type=options.length, help="Side of a square, e.g. 25mm (without a unit: mm).")
@click.option("--reference", metavar="IMAGE", help="Image whose board defines the frame; by default the largest board.")
@click.option("--method", type=click.Choice(list(METHODS)), default="auto", show_default=True,
              help=options.explained(METHODS))
@click.option("--kernel", default="se", show_default=True, help="Kernel: se, ard-se, matern32, matern52 or rq.")
@click.option(
    "--trend",
    default="auto",
    show_default=True,
    help="auto: chosen by evidence. One image: constant (the paper's), homography, lens[:order], polynomial[:order]. "
    "Joint: plane[:order], angle[:order], polynomial[:order], plane-d, angle-d.",
)
@click.option("--refine-corners", is_flag=True,
              help="Look again at the photographs once the camera is known, for more accurate and additional corners.")
@click.option("--mirrored", is_flag=True, help="The camera looks into a mirror: the image is a reflection.")
@click.option("--start", type=click.Path(path_type=Path), metavar="FILE",
              help="Start the joint method from this approximate camera, e.g. last month's or an imported one.")
@click.option("--opencv/--no-opencv", default=True, show_default=True, help="Fit OpenCV's models to compare with.")
@click.option("--heldout/--no-heldout", default=True, show_default=True,
              help="Calibrate again on half of the boards to score the others.")
@click.option("--report", type=click.Path(path_type=Path), metavar="FILE",
              help="Also write a report; FILE ends in .html (one self-contained page), .md or .json.")
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
    """Calibrate a camera from photographs of a board (IMAGES: files, folders, videos) or from a corner table.

    The reference board defines the frame. With --method one-image it alone determines the map, and the other boards
    only determine focal length and principal point. EXIF rotation is ignored: a calibration belongs to the sensor.
    """
    from pinholify.cli.evaluation_output import print_evaluation, to_json
    from pinholify.evaluation.summary import evaluate
    from pinholify.evaluation.verdict import judge
    from pinholify.io.camera_file import read_camera, write_camera
    from pinholify.pipeline import calibrate, recalibrate

    method = chosen_method(method, kernel, trend)
    if refine_corners and table is not None:
        raise click.UsageError("--refine-corners looks at photographs again; a corner table has none")
    if start is not None and method == "one-image":
        raise click.UsageError("the one-image method does not use --start: omit it, or choose --method joint")
    files = input_files(images, table)
    check_outputs(output, report, files if start is None else [*files, start], force=force)
    known = None if start is None else read_camera(start).camera
    mirrored = mirrored or (known is not None and known.mirrored)
    corner_set = gather_corners(images, table, board, image_size, mirrored, needed=FEWEST_BOARDS)
    solve = partial(calibrate, method=method, kernel=kernel, trend=trend, mirrored=mirrored, start=known)
    calibration = solve(corner_set, reference=reference, square_mm=square_mm)
    if refine_corners:
        corner_set = look_again_with_progress(files, corner_set, calibration.camera)
        calibration = solve(corner_set, reference=calibration.reference, square_mm=square_mm)
    again = partial(recalibrate, calibration) if heldout else None
    with keeping(calibration, output):
        evaluation = evaluate(calibration, corner_set, recalibrate=again, compare_opencv=opencv)
        verdict = judge(evaluation, corner_set)
    write_camera(output, calibration)
    if calibration.findings.start_fits is False:
        say(f"'{start}' was not used as a start because it does not explain the corners: is it this camera and mode?")
    if as_json:
        print_json(to_json(evaluation, verdict))
    else:
        print_evaluation(evaluation, verdict)
        click.echo(f"wrote {output}")
    if report is not None:
        write_to(report, gathered_report(evaluation, verdict, images, output), aloud=not as_json)


def check_outputs(camera: Path, report: Path | None, inputs: Sequence[Path], *, force: bool) -> None:
    """Raise OutputError or UsageError if the camera file or the report must not be written."""
    check_camera_output(camera, force=force, inputs=inputs)
    if report == STANDARD_OUTPUT:
        raise click.UsageError("--report needs a file name: standard output is used for the evaluation")
    if report is not None:
        check_report_output(report, (*inputs, camera), force=force)


@contextmanager
def keeping(calibration: Calibration, output: Path) -> Iterator[None]:
    """If the evaluation inside the block meets unsolvable equations, write the camera, then raise CalibrationError."""
    from pinholify.errors import CalibrationError, UnsolvableError
    from pinholify.io.camera_file import write_camera

    try:
        yield
    except UnsolvableError as error:
        write_camera(output, calibration)
        raise CalibrationError(
            f"wrote {output}, but could not evaluate it: {error}; try other photographs with "
            f"'pinholify evaluate {output}'"
        ) from None


def chosen_method(method: str, kernel: str, trend: str) -> str:
    """Resolve ``auto`` if only one method knows ``kernel`` and ``trend``; UsageError if ``method`` does not."""
    from pinholify.errors import InputError
    from pinholify.pipeline import method_knowing

    try:
        return method_knowing(method, kernel, trend)
    except InputError as error:
        raise click.UsageError(str(error)) from None
