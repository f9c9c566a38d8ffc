"""``pinholify calibrate``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from pinholify.board import Board
from pinholify.cli.options import (
    LengthType,
    SizeType,
    board_option,
    check_replaceable,
    force_option,
    json_option,
    print_json,
)
from pinholify.cli.sources import gather_corners, report_missing

METHODS = ("auto", "one-image")


@click.command(
    "calibrate",
    epilog="Examples: pinholify calibrate photos/ --board 15x9 --square 25mm -o camera.npz; "
    "pinholify calibrate --corners corners.vnl --image-size 3840x2160 --board 15x9 -o camera.npz",
)
@click.argument("images", nargs=-1, type=click.Path(path_type=Path))
@board_option
@click.option("-o", "output", type=click.Path(path_type=Path), default="camera.npz", show_default=True, help="Camera file.")
@click.option("--corners", "table", metavar="FILE", help="Take corners from a table (.vnl) instead of photographs.")
@click.option("--image-size", type=SizeType(), help="Size of the images in px; goes with --corners.")
@click.option("--square", "square_mm", type=LengthType(), help="Side of a square, e.g. 25mm.")
@click.option("--reference", metavar="IMAGE", help="Image whose board makes the camera; by default the largest board.")
@click.option("--method", type=click.Choice(METHODS), default="auto", show_default=True, help="How to calibrate.")
@click.option("--kernel", default="se", show_default=True, help="se, ard-se, matern32, matern52 or rq.")
@click.option(
    "--trend",
    default="auto",
    show_default=True,
    help="constant (the paper's), homography, lens[:order], polynomial[:order], or auto: by evidence.",
)
@click.option("--mirrored", is_flag=True, help="The camera looks into a mirror: the image is a reflection.")
@click.option("--opencv/--no-opencv", default=True, show_default=True, help="Fit OpenCV's models to compare with.")
@json_option
@force_option
def command(
    images: tuple[Path, ...],
    board: Board,
    output: Path,
    table: str | None,
    image_size: tuple[int, int] | None,
    square_mm: float | None,
    reference: str | None,
    method: str,
    kernel: str,
    trend: str,
    mirrored: bool,
    opencv: bool,
    as_json: bool,
    force: bool,
) -> None:
    """Make a perfect pinhole camera from photographs of a board (IMAGES: files or folders) or a corner table.

    The board of the reference image makes the camera, the others tell its focal length and principal point. EXIF
    rotation is ignored: a calibration belongs to the sensor.
    """
    check_names(kernel, trend)
    check_output(output, force)
    corner_set = gather_corners(images, table, board, image_size, mirrored)
    report_missing(corner_set)
    from pinholify.cli.report import print_evaluation, to_json
    from pinholify.evaluation.summary import evaluate
    from pinholify.io.camera_file import write_camera
    from pinholify.pipeline import calibrate

    again = partial(calibrate, method=method, kernel=kernel, trend=trend, mirrored=mirrored)
    calibration = again(corner_set, reference=reference, square_mm=square_mm)
    again = partial(again, method=calibration.method)
    evaluation = evaluate(
        calibration, corner_set, recalibrate=lambda part, name: again(part, reference=name), compare_opencv=opencv
    )
    write_camera(output, calibration)
    if as_json:
        print_json(to_json(evaluation))
    else:
        print_evaluation(evaluation)
        click.echo(f"wrote {output}")


def check_names(kernel: str, trend: str) -> None:
    """Raise a usage error when a kernel or trend is not known."""
    from pinholify.errors import InputError
    from pinholify.gp.kernels import kernel_named
    from pinholify.gp.trends import trends_named

    try:
        kernel_named(kernel)
        if trend != "constant":
            trends_named(trend)
    except InputError as error:
        raise click.UsageError(str(error)) from None


def check_output(output: Path, force: bool) -> None:
    """Raise before any work when the camera file cannot be written or would replace something else."""
    from pinholify.io.camera_file import is_camera_file
    from pinholify.io.files import check_writable

    check_writable(output)
    check_replaceable(output, force, is_camera_file)
