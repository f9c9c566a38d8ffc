"""``pinholify demo``."""

from __future__ import annotations

from pathlib import Path

import click

from pinholify.cli.options import say


@click.command("demo", epilog="Example: pinholify demo -o demo/")
@click.option(
    "-o", "folder", type=click.Path(path_type=Path), default="demo", show_default=True, help="Folder to write into."
)
def command(folder: Path) -> None:
    """Render a warped scene, run the whole chain on it, and write pictures and numbers into a folder.

    The folder's own files of an earlier demo are replaced; nothing else in it is touched.
    """
    from pinholify.cli.report import print_evaluation
    from pinholify.demo import run_demo

    result = run_demo(folder, step=lambda text: say(f"{text} …"))
    print_evaluation(result.evaluation)
    click.echo(f"largest error of f, uc, vc against truth: {result.intrinsics_error:.4f} squares")
    click.echo(f"look at {folder / 'before-after.jpg'}, {folder / 'board.jpg'} and {folder / 'collinearity.jpg'}")
