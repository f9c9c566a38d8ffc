"""The command ``pinholify detect``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pinholify.cli.options import (
    Auto,
    board_option,
    check_output,
    examples,
    force_option,
    json_option,
    print_json,
    say,
)
from pinholify.cli.sources import detect_with_progress, input_files, is_corner_table

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.board import Board
    from pinholify.corners import CornerSet


@click.command(
    "detect",
    epilog=examples(
        "pinholify detect photos/*.jpg --board 15x9 -o corners.vnl",
        "pinholify detect photos/ --board auto --json -o corners.vnl",
        "pinholify detect photos/ --board 15x9 --camera camera.npz -o more-corners.vnl",
    ),
)
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path))
@board_option
@click.option("-o", "output", type=click.Path(), default="-", show_default=True, help="Corner table to write.")
@click.option("--camera", type=click.Path(path_type=Path), metavar="FILE",
              help="The camera that took the images: look again for missed corners where it expects them.")
@click.option("--mirrored", is_flag=True, help="The image is a reflection: number the corners left-handed.")
@click.option("--workers", type=click.IntRange(1), help="Number of processes; by default one per core.")
@json_option
@force_option
def command(
    images: tuple[Path, ...],
    board: Board | Auto,
    output: str,
    camera: Path | None,
    mirrored: bool,
    workers: int | None,
    as_json: bool,
    force: bool,
) -> None:
    """Find the inner corners of a board in IMAGES (files, folders, videos) and write them as a corner table.

    EXIF rotation is ignored: a calibration belongs to the sensor. File names with blanks are not
    allowed in a corner table: rename such files, or use --json. With --json and -o - the table is not printed.
    """
    from pinholify.io.camera_file import read_camera
    from pinholify.io.corner_tables import check_name, write_corner_table

    files = input_files(images, None)
    if output != "-":
        check_output(Path(output), force=force, is_ours=is_corner_table, inputs=files)
    if output != "-" or not as_json:
        for file in files:
            check_name(file.name)
    known = None if camera is None else read_camera(camera).camera
    if known is not None and mirrored and not known.mirrored:
        raise click.UsageError(
            f"the camera '{camera}' is not mirrored, but --mirrored declares the images to be reflections: omit "
            "--mirrored, or give the camera that took the images"
        )
    mirrored = mirrored or (known is not None and known.mirrored)
    corners = detect_with_progress(files, board, mirrored, camera=known, workers=workers)
    if output != "-":
        write_corner_table(output, corners)
        say(f"wrote {output}: boards in {len(corners.found)} of {len(corners.views)} images")
    elif not as_json:
        write_corner_table(sys.stdout, corners)
    if as_json:
        print_json(to_json(corners))


def to_json(corners: CornerSet) -> dict[str, Any]:
    """The object that ``--json`` prints."""
    return {
        "format_version": 1,
        "board": corners.board.spec,
        "image_size": list(corners.image_size),
        "images": [
            {
                "file": view.name,
                "found": view.found,
                "corners": len(view),
                "reason": view.reason,
                "orientation": "assumed" if view.orientation_assumed else "known",
                "ambiguous_offset": view.ambiguous_offset,
            }
            for view in corners.views
        ],
    }
