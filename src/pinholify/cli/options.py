"""Options, parameter types and output checks that several commands share."""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeVar

import click

from pinholify.errors import BoardError, OutputError

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.board import Board

F = TypeVar("F", bound=Callable[..., Any])

Auto = Literal["auto"]
AUTO: Final = "auto"

CAMERA_SUFFIX = ".npz"

LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}


def board(text: str) -> Board:
    """Parse a board such as 15x9; raises BadParameter, which lists the valid forms."""
    from pinholify.board import parse_board

    try:
        return parse_board(text)
    except BoardError as error:
        raise click.BadParameter(str(error)) from None


def board_or_auto(text: str) -> Board | Auto:
    """Parse a board, or "auto" to detect it from the photographs; raises BadParameter, which lists the valid forms."""
    return AUTO if text.strip() == AUTO else board(text)


def size(text: str) -> tuple[int, int]:
    """Parse a size such as 1920x1080 as (width, height) in px; raises BadParameter."""
    match = re.fullmatch(r"([1-9]\d{0,5})[xX×]([1-9]\d{0,5})", text)
    if match is None:
        raise click.BadParameter(f"invalid size '{text}': write WIDTHxHEIGHT in px, for example 1920x1080")
    return int(match[1]), int(match[2])


def length(text: str) -> float:
    """Parse a length such as 25mm, 2.5cm or 1in as millimetres, the default unit; raises BadParameter."""
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*(mm|cm|m|in)?", text)
    millimetres = float(match[1]) * LENGTHS[match[2] or "mm"] if match else 0.0
    if millimetres <= 0:
        raise click.BadParameter(f"invalid length '{text}': write for example 25mm, 2.5cm or 1in")
    return millimetres


def explained(choices: Mapping[str, str]) -> str:
    """The help of an option with these ``choices``, each with its meaning; those with the same meaning are joined."""
    names: dict[str, list[str]] = {}
    for name, meaning in choices.items():
        names.setdefault(meaning, []).append(name)
    return "; ".join(f"{', '.join(some)}: {meaning}" for meaning, some in names.items()) + "."


def board_option(function: F) -> F:
    """Add the required option ``--board``."""
    return click.option(
        "--board",
        type=board_or_auto,
        required=True,
        help="The board: inner corners, columns x rows, e.g. 15x9; auto: the checkerboard that most photographs show "
        "whole; or charuco:9x7:DICT_4X4_100:0.5, aprilgrid:6x6:tag36h11:0.3, circles:7x5, circles:4x11:asymmetric, "
        "gray:1920x1080:16.",
    )(function)


def json_option(function: F) -> F:
    """Add the flag ``--json``, passed as ``as_json``."""
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of text.")(function)


def overwrite_option(function: F) -> F:
    """Add ``--force`` to a command that refuses to replace any existing file without it."""
    return click.option("--force", is_flag=True, help="Replace existing files; without it the command refuses to.")(
        function
    )


def force_option(function: F) -> F:
    """Add ``--force`` to a command that recognises its own earlier results and always replaces them."""
    return click.option(
        "--force", is_flag=True, help="Replace any file; an earlier result of the same kind is always replaced."
    )(function)


def print_json(data: dict[str, Any]) -> None:
    """Print one JSON object on standard output; numbers that are not finite become null."""
    click.echo(json.dumps(_finite(data), indent=2))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def progress(description: str, total: int | None) -> Iterator[Callable[[], None]]:
    """Show a progress bar on standard error if that is a terminal; yields the function that advances it by one."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(description, total=total)
        yield lambda: bar.advance(task)


def check_output(
    path: Path,
    *,
    force: bool,
    is_ours: Callable[[Path], bool] = lambda _: False,
    inputs: Iterable[str | Path] = (),
) -> None:
    """Raise OutputError, before any work, if ``path`` must not be written.

    That is if it is not writable, if it is one of the ``inputs``, or, without ``force``, if it exists, is not empty and
    ``is_ours`` does not recognise it as an earlier result of the same kind.
    """
    from pinholify.io.files import check_writable

    check_writable(path)
    if not path.exists():
        return
    if any(os.path.exists(source) and path.samefile(source) for source in inputs):
        raise OutputError(f"'{path}' is one of the inputs; write to another file")
    if not force and path.stat().st_size and not is_ours(path):
        raise OutputError(f"'{path}' is already there; choose another name, or use --force")


def check_camera_output(path: Path, *, force: bool, inputs: Iterable[str | Path] = ()) -> None:
    """Apply :func:`check_output` to a camera file, and raise OutputError if its name does not end in .npz."""
    from pinholify.io.camera_file import is_camera_file

    check_output(path, force=force, is_ours=is_camera_file, inputs=inputs)
    if path.suffix.lower() != CAMERA_SUFFIX:
        raise OutputError(f"'{path}' is not a valid name for a camera file: it must end in {CAMERA_SUFFIX}")


def examples(*lines: str) -> str:
    """The examples at the end of a help text: command ``lines``, never re-wrapped."""
    return "\b\n" + "\n  ".join(["Example:" if len(lines) == 1 else "Examples:", *lines])


def say(text: str) -> None:
    """Print a message on standard error."""
    click.echo(text, err=True)
