"""Options that several commands share, and how their texts are read."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click

from pinholify.board import Board, parse_board
from pinholify.errors import BoardError, OutputError

F = TypeVar("F", bound=Callable[..., Any])

LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}


class BoardType(click.ParamType):
    """A board such as 15x9."""

    name = "board"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Board:
        """The board, or a usage error that says what may be written."""
        try:
            return parse_board(value) if isinstance(value, str) else value
        except BoardError as error:
            self.fail(str(error), param, ctx)


class SizeType(click.ParamType):
    """A size in px such as 1920x1080."""

    name = "WxH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """(width, height)."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"([1-9]\d{0,5})[xX×]([1-9]\d{0,5})", value)
        if match is None:
            self.fail(f"'{value}' is no size; write width x height in px, for example 1920x1080", param, ctx)
        return int(match[1]), int(match[2])


class LengthType(click.ParamType):
    """A length such as 25mm; without a unit, millimetres."""

    name = "length"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Millimetres."""
        if isinstance(value, float):
            return value
        match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*(mm|cm|m|in)?", value)
        length = float(match[1]) * LENGTHS[match[2] or "mm"] if match else 0.0
        if length <= 0:
            self.fail(f"'{value}' is no length; write for example 25mm, 2.5cm or 1in", param, ctx)
        return length


def board_option(function: F) -> F:
    """``--board``, required."""
    return click.option(
        "--board", type=BoardType(), required=True, help="Inner corners of the board, columns x rows, e.g. 15x9."
    )(function)


def json_option(function: F) -> F:
    """``--json``."""
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of text.")(function)


def force_option(function: F) -> F:
    """``--force``."""
    return click.option("--force", is_flag=True, help="Replace files that are already there.")(function)


def print_json(data: dict[str, Any]) -> None:
    """One JSON object on standard output; numbers that do not exist are null."""
    click.echo(json.dumps(_finite(data), indent=2))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def progress(description: str, total: int | None) -> Iterator[Callable[[], None]]:
    """A progress bar on standard error where that is a terminal; yields the function that advances it."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(description, total=total)
        yield lambda: bar.advance(task)


def check_replaceable(path: Path, force: bool, is_ours: Callable[[Path], bool]) -> None:
    """Raise OutputError when ``path`` is a file that may not be replaced: one that is not of the kind to be written."""
    if path.exists() and not force and not path.is_dir() and path.stat().st_size and not is_ours(path):
        raise OutputError(f"'{path}' is already there and is something else; choose another name, or say --force")


def say(text: str) -> None:
    """A line for the person, on standard error."""
    click.echo(text, err=True)
