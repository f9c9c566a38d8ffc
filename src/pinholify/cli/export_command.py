"""The command ``pinholify export``."""

from __future__ import annotations

from pathlib import Path

import click

from pinholify.cli.options import check_output, examples, overwrite_option, say
from pinholify.cli.view_options import flat_view_options
from pinholify.io.export import FORMATS
from pinholify.rectification.options import ViewOptions

FORMAT_LIST = "\b\nFormats:\n" + "\n".join(f"  {name:14} {title}" for name, title in FORMATS.items())


@click.command(
    "export",
    epilog=f"{FORMAT_LIST}\n\n{examples('pinholify export camera.npz --format ros --view camera -o camera_info.yaml')}",
)
@click.argument("camera", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "format_name",
    type=click.Choice(list(FORMATS)),
    required=True,
    metavar="NAME",
    help="Format to write; see the list below.",
)
@flat_view_options
@click.option("-o", "output", type=click.Path(path_type=Path), required=True, help="File to write.")
@overwrite_option
def command(
    camera: Path,
    format_name: str,
    view: ViewOptions,
    output: Path,
    force: bool,
) -> None:
    """Write an ideal pinhole view of CAMERA, or the camera itself, in the format of another program.

    The view has no distortion: it describes images made by 'pinholify undistort' with the same --view, --size, --turn,
    --fov, --keep and --max-std. Only mrcal-splined describes the original images. What the view or the format leaves
    out is reported on standard error.
    """
    from pinholify.io.camera_file import read_camera
    from pinholify.io.export import format_named
    from pinholify.io.export.base import export_view

    form = format_named(format_name)
    form.check_path(output)
    for file in form.files(output):
        check_output(file, force=force, inputs=(camera,))
    lost = export_view(read_camera(camera).camera, format_name, output, view)
    what = f"view '{view.name}'" if form.of_view else "the camera"
    click.echo(f"wrote {' and '.join(str(file) for file in form.files(output))}: {what} for {format_name}")
    for sentence in lost:
        say(f"note: {sentence}")
