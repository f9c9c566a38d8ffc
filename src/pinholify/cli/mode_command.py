"""``pinholify mode``."""

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
    """(left, top, (width, height)) in px of a text such as 0,240,3840x2160; raises BadParameter."""
    match = re.fullmatch(r"(\d{1,6}),(\d{1,6}),(\S+)", text.strip())
    if match is None:
        raise click.BadParameter(f"'{text}' is no crop; write LEFT,TOP,WxH in px, for example 0,240,3840x2160")
    return int(match[1]), int(match[2]), options.size(match[3])


@click.command("mode", epilog=EXAMPLES)
@click.argument("camera", type=click.Path(path_type=Path))
@click.option("-o", "output", type=click.Path(path_type=Path), required=True, help="Camera file to write.")
@click.option("--crop", "part", type=crop, metavar="LEFT,TOP,WxH", help="Only this part of the image is read, in px.")
@click.option("--bin", "factor", type=click.IntRange(1), metavar="N", help="N x N pixels are read as one.")
@click.option("--size", type=options.size, metavar="WxH", help="All that is read is resampled to this size.")
@force_option
def command(
    camera: Path,
    output: Path,
    part: tuple[int, int, tuple[int, int]] | None,
    factor: int | None,
    size: tuple[int, int] | None,
    force: bool,
) -> None:
    """Make of CAMERA the one that another mode of the same sensor is: cropped, binned, scaled, in this order.

    Nothing is calibrated anew, and the corners stay behind: 'evaluate' scores it on photographs of its own mode.
    Cameras often crop video where photographs are whole; what is cropped stands in the camera's manual.
    """
    from dataclasses import replace

    from pinholify.corners import CornerSet
    from pinholify.io.camera_file import read_camera, write_camera
    from pinholify.modes import binned, cropped, scaled

    if part is None and factor is None and size is None:
        raise click.UsageError("say what the mode does: --crop, --bin or --size")
    check_camera_output(output, force=force, inputs=(camera,))
    calibration = read_camera(camera)
    mode = calibration.camera
    mode = cropped(mode, *part) if part is not None else mode
    mode = binned(mode, factor) if factor is not None else mode
    mode = scaled(mode, size) if size is not None else mode
    corners = CornerSet(calibration.corner_set.board, mode.image_size)
    write_camera(output, replace(calibration, camera=mode, corner_set=corners))
    (width, height), (was_width, was_height) = mode.image_size, calibration.camera.image_size
    click.echo(f"wrote {output}: images of {width}x{height}, calibrated at {was_width}x{was_height}")
