"""The command ``pinholify demo``."""

from __future__ import annotations

from pathlib import Path

import click

from pinholify.cli.options import examples, force_option, say


@click.command("demo", epilog=examples("pinholify demo -o demo/"))
@click.option(
    "-o", "folder", type=click.Path(path_type=Path), default="demo", show_default=True, help="Folder to write into."
)
@force_option
def command(folder: Path, force: bool) -> None:
    """Render a warped scene, calibrate from it, straighten it, and write pictures and numbers into a folder.

    The files of an earlier demo are replaced; a folder that holds anything else is refused without --force.
    """
    from pinholify.cli.evaluation_output import print_evaluation
    from pinholify.demo import ABOUT, run_demo
    from pinholify.errors import OutputError

    if folder.is_dir() and any(folder.iterdir()) and not (folder / ABOUT).exists() and not force:
        raise OutputError(f"the folder '{folder}' holds other files; choose a new one with -o, or use --force")
    result = run_demo(folder, step=lambda text: say(f"{text} …"))
    print_evaluation(result.evaluation, result.verdict)
    click.echo(f"largest error of f, uc, vc against the truth: {result.intrinsics_error:.4f} squares")
    click.echo(f"see {folder / 'before-after.jpg'}, {folder / 'board.jpg'} and {folder / 'collinearity.jpg'}")
