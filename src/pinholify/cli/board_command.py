"""``pinholify board``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli import options
from pinholify.cli.options import check_output, examples, force_option

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.board import Board


@click.command("board", epilog=examples("pinholify board 9x6 --square 25mm --page A4 -o board.pdf"))
@click.argument("board", type=options.board)
@click.option("--square", "square_mm", type=options.length, required=True, help="Side of a square, e.g. 25mm.")
@click.option("--page", default="A4", show_default=True, help="A0 to A5, Letter, Legal, Tabloid, or WxHmm.")
@click.option("-o", "output", type=click.Path(path_type=Path), default="board.pdf", show_default=True,
              help="File to write; .pdf, .svg or .png.")
@force_option
def command(board: Board, square_mm: float, page: str, output: Path, force: bool) -> None:
    """Print BOARD (inner corners, columns x rows) true to scale as PDF, SVG or PNG.

    Print without "fit to page" and check the ruler on the sheet.
    """
    from pinholify.io.board_print import write_board

    check_output(output, force=force)
    write_board(board, output, square_mm=square_mm, page=page)
    click.echo(f"wrote {output}")
