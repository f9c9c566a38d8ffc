"""The command ``pinholify board``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli import options
from pinholify.cli.options import check_output, examples, overwrite_option

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.board import Board


@click.command(
    "board",
    epilog=examples(
        "pinholify board 9x6 --square 25mm --page A4 -o board.pdf",
        "pinholify board charuco:9x7:DICT_4X4_100:0.5 --square 20mm",
        "pinholify board aprilgrid:6x6:tag36h11:0.3 --square 20mm",
        "pinholify board circles:4x11:asymmetric --square 17mm",
    ),
)
@click.argument("board", type=options.board)
@click.option(
    "--square",
    "square_mm",
    type=options.length,
    required=True,
    help="Side of a square or tag, or spacing of circles, e.g. 25mm (without a unit: mm).",
)
@click.option("--page", default="A4", show_default=True, help="Paper: A0 to A5, Letter, Legal, Tabloid, or WxHmm.")
@click.option(
    "-o",
    "output",
    type=click.Path(path_type=Path),
    default="board.pdf",
    show_default=True,
    help="File to write: .pdf, .svg or .png.",
)
@overwrite_option
def command(board: Board, square_mm: float, page: str, output: Path, force: bool) -> None:
    """Draw BOARD true to scale as PDF, SVG or PNG.

    A checkerboard is given by its inner corners, columns x rows; a ChArUco board by squares, dictionary and marker side
    ÷ square side; an AprilGrid (Kalibr's) by tags, family and gap ÷ tag side; a circle grid by columns x rows. Append
    :DIAMETER, as a fraction of --square, if it is not 0.5. In an asymmetric grid neighbouring rows are one --square
    apart.

    Print it without "fit to page", then check the ruler on the sheet.
    """
    from pinholify.io.board_print import write_board

    check_output(output, force=force)
    write_board(board, output, square_mm=square_mm, page=page)
    click.echo(f"wrote {output}")
