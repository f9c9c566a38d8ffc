"""``pinholify import``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli import options
from pinholify.cli.options import check_camera_output, examples, force_option, json_option, print_json, say
from pinholify.io.importing import PROGRAMS

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.board import Board

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
@click.option("--from", "program", type=click.Choice(list(PROGRAMS)), help="Whose file it is; recognised by default.")
@click.option("--camera", metavar="NAME", help="Which camera, where FILE holds several, e.g. cam1.")
@click.option("--image-size", type=options.size, metavar="WxH", help="Size of the images in px, if FILE lacks it.")
@click.option("--fisheye/--no-fisheye", default=None,
              help="Whether OpenCV's 4 coefficients are those of cv2.fisheye, if FILE does not tell.")
@click.option("--board", type=options.board, help="Board for 'evaluate' to look for: inner corners, e.g. 15x9.")
@click.option("--square", "square_mm", type=options.length, help="Side of that board's square, e.g. 25mm.")
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
    """Make FILE, a camera that another program calibrated, a camera of ours for all other commands.

    Its lens is repeated by a spline over the image, and how well is told. How well the camera was calibrated is not in
    such files: standard deviations are of the repetition alone. One square of its virtual plane is one pixel of its
    ideal pinhole image.
    """
    from pinholify.io.camera_file import write_camera
    from pinholify.io.importing import read_foreign
    from pinholify.io.importing.adoption import adopt
    from pinholify.splines import rounded_up

    check_camera_output(output, force=force, inputs=(file,))
    theirs = read_foreign(file, program=program, camera=camera, image_size=image_size, fisheye=fisheye)
    adopted = adopt(theirs, board=board, square_mm=square_mm)
    write_camera(output, adopted.calibration)
    intrinsics = adopted.calibration.camera.intrinsics
    if as_json:
        print_json(
            {
                "format_version": 1,
                "program": theirs.program,
                "model": theirs.model,
                "image_size": theirs.image_size,
                "f": intrinsics.f,
                "uc": intrinsics.uc,
                "vc": intrinsics.vc,
                "mirrored": adopted.calibration.camera.mirrored,
                "fit_rms_px": adopted.rms_px,
                "fit_largest_px": adopted.largest_px,
                "covered": adopted.covered,
                "knots": adopted.knots,
            }
        )
        return
    width, height = theirs.image_size
    click.echo(f"{theirs.program} {theirs.model}, {width}x{height}: f {intrinsics.f:.2f} px")
    click.echo(f"repeated to {adopted.rms_px:.2g} px rms, {rounded_up(adopted.largest_px)} px at most")
    if adopted.calibration.camera.mirrored:
        fx, fy = theirs.focal
        say(f"note: the image is a reflection, as fx = {fx:g} and fy = {fy:g}: does the camera look into a mirror?")
    if adopted.covered < FULL:
        left_out = 1.0 - adopted.covered
        say(f"note: {left_out:.1%} of the image is left out: there the lens model folds, ends or bends too sharply")
    click.echo(f"wrote {output}")
