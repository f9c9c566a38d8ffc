"""The command ``pinholify reproduce``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli.options import examples, force_option, json_option, print_json, progress, say

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.reproduction.run import Reproduction

NARROWEST = 180  # characters; the width of the widest table


@click.command("reproduce", epilog=examples("pinholify reproduce -o paper/ --quick"))
@click.option("-o", "folder", type=click.Path(path_type=Path), required=True, help="Folder to write into.")
@click.option("--quick", is_flag=True, help="Use smaller images and fewer boards; takes about two minutes.")
@json_option
@force_option
def command(folder: Path, quick: bool, as_json: bool, force: bool) -> None:
    """Reproduce the paper: render its six data sets, calibrate them, and set tables and figures next to its own.

    Takes about half an hour on two cores. When an interrupted run is repeated, data sets already rendered are reused. A
    folder that holds anything but an earlier run is refused without --force. Needs matplotlib.
    """
    from pinholify.errors import OutputError
    from pinholify.reproduction.run import PHOTOGRAPHS, reproduce

    if folder.is_dir() and any(folder.iterdir()) and not (folder / PHOTOGRAPHS).exists() and not force:
        raise OutputError(f"the folder '{folder}' holds other files; choose a new one with -o, or use --force")
    reproduction = reproduce(folder, quick=quick, watch=_watch, workers=None)
    if as_json:
        print_json(reproduction.numbers)
    else:
        _print(reproduction)
        click.echo(f"see {reproduction.page}")


@contextmanager
def _watch(text: str, parts: int | None) -> Iterator[Callable[[], None]]:
    say(f"{text} …")
    with progress(text, parts) as advance:
        yield advance


def _print(reproduction: Reproduction) -> None:
    """Print the tables and findings on standard output."""
    from rich.console import Console
    from rich.table import Table

    from pinholify.reproduction.findings import findings
    from pinholify.reproduction.tables import all_tables

    console = Console(highlight=False)
    console.width = max(console.width, NARROWEST)
    for table in all_tables(reproduction.results):
        printed = Table(title=table.title, title_justify="left", caption=table.note, caption_justify="left", box=None)
        for column, header in enumerate(table.header):
            printed.add_column(header, justify="right" if column else "left", no_wrap=not column)
        for row in table.rows:
            printed.add_row(*row)
        console.print(printed, "")
    for finding in findings(reproduction.results):
        verdict = "[green]agrees[/]" if finding.agrees else "[red]differs[/]"
        console.print(f"[bold]{finding.claim}:[/] {verdict}. {finding.text}")
