"""``pinholify detect``."""

from __future__ import annotations

from pathlib import Path

import click

from pinholify.board import Board
from pinholify.cli.options import board_option, check_replaceable, force_option, json_option, print_json
from pinholify.cli.sources import detect_with_progress, is_corner_table, report_missing
from pinholify.errors import CalibrationError


@click.command(
    "detect", epilog="Example: pinholify detect photos/*.jpg --board 15x9 -o corners.vnl"
)
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path))
@board_option
@click.option("-o", "output", type=click.Path(), default="-", show_default=True, help="Corner table to write.")
@click.option("--mirrored", is_flag=True, help="The image is a reflection: number the corners left-handed.")
@click.option("--workers", type=click.IntRange(1), help="Processes to use; all cores by default.")
@json_option
@force_option
def command(
    images: tuple[Path, ...],
    board: Board,
    output: str,
    mirrored: bool,
    workers: int | None,
    as_json: bool,
    force: bool,
) -> None:
    """Find the inner corners of a board in IMAGES (files or folders) and write them as a corner table.

    EXIF rotation is ignored: a calibration belongs to the sensor. With --json and -o - the table is not printed.
    """
    import sys

    from pinholify.io.corner_tables import write_corner_table

    if output != "-":
        check_replaceable(Path(output), force, is_corner_table)
    corners = detect_with_progress(images, board, mirrored, workers)
    if not corners.found:
        reasons = sorted({view.reason for view in corners.views})
        raise CalibrationError(f"no {board.spec} board was found in any of the {len(corners.views)} images: {reasons[0]}")
    report_missing(corners)
    if output != "-":
        write_corner_table(output, corners)
    elif not as_json:
        write_corner_table(sys.stdout, corners)
    if as_json:
        print_json(
            {
                "format_version": 1,
                "board": board.spec,
                "image_size": list(corners.image_size),
                "images": [
                    {
                        "file": v.name,
                        "found": v.found,
                        "corners": len(v),
                        "reason": v.reason,
                        "orientation": "assumed" if v.orientation_assumed else "known",
                        "ambiguous_offset": v.ambiguous_offset,
                    }
                    for v in corners.views
                ],
            }
        )
