"""The command ``pinholify mode``."""

from __future__ import annotations

import re
from pathlib import Path

import click

from pinholify.cli import options
from pinholify.cli.options import check_camera_output, examples, force_option

EXAMPLES = examples(
    "pinholify mode photos.npz --size 1920x1440 -o half.npz",
    "pinholify mode photos.npz --crop 0,420,5472x3078 --size 3840x2160 -o video.npz",
)


def crop(text: str) -> tuple[int, int, tuple[int, int]]:
    """Parse a crop such as 0,240,3840x2160 as (left, top, (width, height)) in px; raises BadParameter."""
    match = re.fullmatch(r"(\d{1,6}),(\d{1,6}),(\S+)", text.strip())
    if match is None:
        raise click.BadParameter(f"invalid crop '{text}': write LEFT,TOP,WxH in px, for example 0,240,3840x2160")
    return int(match[1]), int(match[2]), options.size(match[3])


@click.command("mode", epilog=EXAMPLES)
@click.argument("camera", type=click.Path(path_type=Path))
@click.option("-o", "output", type=click.Path(path_type=Path), required=True, help="Camera file to write.")
@click.option("--crop", "part", type=crop, metavar="LEFT,TOP,WxH", help="The mode reads only this part of the image.")
@click.option("--bin", "factor", type=click.IntRange(1), metavar="N", help="The mode reads N x N pixels as one.")
@click.option("--size", type=options.size, metavar="WxH", help="The mode resamples its image to this size.")
@force_option
def command(
    camera: Path,
    output: Path,
    part: tuple[int, int, tuple[int, int]] | None,
    factor: int | None,
    size: tuple[int, int] | None,
    force: bool,
) -> None:
    """Convert CAMERA to another mode of the same sensor: cropped, binned and scaled, in this order.

    Nothing is calibrated again, and the corners are not kept: score the result with 'evaluate' on photographs of its
    own mode. Cameras often crop video but not photographs; the camera's manual gives the crop.
    """
    from dataclasses import replace

    from pinholify.corners import CornerSet
    from pinholify.io.camera_file import read_camera, write_camera
    from pinholify.modes import binned, cropped, scaled

    if part is None and factor is None and size is None:
        raise click.UsageError("give at least one of --crop, --bin and --size")
    check_camera_output(output, force=force, inputs=(camera,))
    calibration = read_camera(camera)
    mode = calibration.camera
    if part is not None:
        mode = cropped(mode, *part)
    if factor is not None:
        mode = binned(mode, factor)
    if size is not None:
        mode = scaled(mode, size)
    corners = CornerSet(calibration.corner_set.board, mode.image_size)
    asked = calibration.settings and replace(calibration.settings, start=None)  # which was a camera of the old mode
    write_camera(output, replace(calibration, camera=mode, corner_set=corners, settings=asked))
    (width, height), (was_width, was_height) = mode.image_size, calibration.camera.image_size
    click.echo(f"wrote {output}: images of {width}x{height}, calibrated at {was_width}x{was_height}")
