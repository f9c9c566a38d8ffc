"""The command ``pinholify compare``."""

from __future__ import annotations

from pathlib import Path

import click

from pinholify.cli.options import check_output, examples, json_option, overwrite_option, print_json

CHANGED = 2.0  # times the difference expected from the cameras' own uncertainty


@click.command("compare", epilog=examples("pinholify compare january.npz june.npz -o difference.png"))
@click.argument("first", type=click.Path(path_type=Path))
@click.argument("second", type=click.Path(path_type=Path))
@click.option("-o", "picture", type=click.Path(path_type=Path), help="Also draw the difference over the image (PNG).")
@click.option("--strict", is_flag=True,
              help="Exit with 1 if the cameras differ by more than twice what their uncertainty predicts.")
@json_option
@overwrite_option
def command(first: Path, second: Path, picture: Path | None, strict: bool, as_json: bool, force: bool) -> None:
    """Measure how far the rays of two cameras differ over the image, in px, after the best rotation.

    Has a camera changed since last month? Do two sets of photographs agree? The difference is printed together with the
    one expected from the cameras' own uncertainty.
    """
    from pinholify.errors import CalibrationError
    from pinholify.io.camera_file import read_camera
    from pinholify.refinement.comparison import compare

    if picture is not None:
        check_output(picture, force=force, inputs=(first, second))
    one, two = read_camera(first).camera, read_camera(second).camera
    result = compare(one, two)
    ratio = result.rms() / result.expected_rms
    same = ratio < CHANGED
    if picture is not None:
        from pinholify.io.comparison_picture import difference_picture
        from pinholify.io.images import write_image

        write_image(picture, difference_picture(result, one.image_size))
    if as_json:
        print_json(
            {
                "format_version": 1,
                "rms_px": result.rms(),
                "rms_everywhere_px": result.rms(everywhere=True),
                "expected_rms_px": result.expected_rms,
                "agree": bool(same),
            }
        )
    else:
        click.echo(
            f"difference {result.rms():.4f} px RMS inside both cameras' domains ({result.rms(everywhere=True):.4f} px "
            f"over the whole image); their own uncertainty explains {result.expected_rms:.4f} px"
        )
        click.echo("the cameras agree" if same else f"the cameras differ: {ratio:.1f} times the expected difference")
    if strict and not same:
        raise CalibrationError(f"the cameras differ by {ratio:.1f} times what their uncertainty explains")
