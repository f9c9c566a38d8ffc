"""The command ``pinholify import``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pinholify.cli import options
from pinholify.cli.options import check_camera_output, examples, force_option, json_option, print_json, say
from pinholify.io.importing import PROGRAMS

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.board import Board
    from pinholify.io.importing.adoption import Adopted
    from pinholify.io.importing.base import ForeignCamera

FULL = 0.9995  # share of the image that counts as all of it

PROGRAM_LIST = "\b\nPrograms:\n" + "\n".join(f"  {name:8} {what}" for name, what in PROGRAMS.items())
EXAMPLES = examples(
    "pinholify import camera.cameramodel -o theirs.npz",
    "pinholify import camchain.yaml --camera cam1 -o right.npz",
    "pinholify compare ours.npz theirs.npz",
)


@click.command("import", epilog=f"{PROGRAM_LIST}\n\n{EXAMPLES}")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "output", type=click.Path(path_type=Path), required=True, help="Camera file to write.")
@click.option("--from", "program", type=click.Choice(list(PROGRAMS)),
              help="The program that wrote FILE; by default recognised from its content.")
@click.option("--camera", metavar="NAME", help="Which camera to take if FILE holds several, e.g. cam1.")
@click.option("--image-size", type=options.size, metavar="WxH", help="Size of the images in px, if not in FILE.")
@click.option("--fisheye/--no-fisheye", default=None,
              help="Whether OpenCV's 4 coefficients are those of cv2.fisheye, if FILE does not say so.")
@click.option("--board", type=options.board, help="Board that 'evaluate' will look for: inner corners, e.g. 15x9.")
@click.option("--square", "square_mm", type=options.length,
              help="Side of a square of that board, e.g. 25mm (without a unit: mm).")
@json_option
@force_option
def command(
    file: Path,
    output: Path,
    program: str | None,
    camera: str | None,
    image_size: tuple[int, int] | None,
    fisheye: bool | None,
    board: Board | None,
    square_mm: float | None,
    as_json: bool,
    force: bool,
) -> None:
    """Convert FILE, a camera calibrated by another program, to a camera file for all other commands.

    The lens is reproduced by a spline over the image, and the fit error is printed. Such files do not contain the
    uncertainty of the calibration, so standard deviations are those of the fit alone. One square of the virtual plane
    is one pixel of the camera's ideal pinhole image.
    """
    from pinholify.io.camera_file import write_camera
    from pinholify.io.importing import read_foreign
    from pinholify.io.importing.adoption import adopt

    check_camera_output(output, force=force, inputs=(file,))
    theirs = read_foreign(file, program=program, camera=camera, image_size=image_size, fisheye=fisheye)
    adopted = adopt(theirs, board=board, square_mm=square_mm)
    write_camera(output, adopted.calibration)
    if as_json:
        print_json(to_json(theirs, adopted))
    else:
        print_adopted(theirs, adopted)
        click.echo(f"wrote {output}")


def to_json(theirs: ForeignCamera, adopted: Adopted) -> dict[str, Any]:
    """The object that ``--json`` prints."""
    camera = adopted.calibration.camera
    return {
        "format_version": 1,
        "program": theirs.program,
        "model": theirs.model,
        "image_size": theirs.image_size,
        **asdict(camera.intrinsics),
        "mirrored": camera.mirrored,
        "fit_rms_px": adopted.rms_px,
        "fit_largest_px": adopted.largest_px,
        "covered": adopted.covered,
        "knots": adopted.knots,
    }


def print_adopted(theirs: ForeignCamera, adopted: Adopted) -> None:
    """Print the camera and its fit error; notes on what may surprise go to standard error."""
    from pinholify.splines import rounded_up

    camera, (width, height) = adopted.calibration.camera, theirs.image_size
    click.echo(f"{theirs.program} {theirs.model}, {width}x{height}: f {camera.intrinsics.f:.2f} px")
    click.echo(f"fit error: {adopted.rms_px:.2g} px RMS, at most {rounded_up(adopted.largest_px)} px")
    if camera.mirrored:
        fx, fy = theirs.focal
        say(f"note: the image is a reflection, because fx = {fx:g} and fy = {fy:g}: is there a mirror?")
    if adopted.covered < FULL:
        left_out = 100 * (1.0 - adopted.covered)
        say(f"note: {left_out:.1f} % of the image is left out: there the lens model folds, ends or bends too sharply")
