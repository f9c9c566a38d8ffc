"""The formats in which a report is written. To add one, write a module with ``render`` and add a line here.

Modules are imported only when their format is used.
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import TYPE_CHECKING

from pinholify.errors import InputError
from pinholify.io.files import writing_text

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.report.contents import Report

FORMATS = {
    "html": "one self-contained page",
    "md": "text and tables",
    "json": "numbers",
}
"""Name of each format, its module and file extension → its description."""

MARK = "pinholify-report"
"""A mark near the start of every report, whatever its format."""

MARK_WITHIN = 2048  # bytes


def render(report: Report, form: str) -> str:
    """``report`` as text in the format ``form``; raises InputError for an unknown format."""
    if form not in FORMATS:
        raise InputError(f"unknown report format '{form}': choose one of {', '.join(FORMATS)}")
    text: str = importlib.import_module(f"pinholify.report.formats.{form}").render(report)
    return text.encode("utf-8", "backslashreplace").decode("utf-8")  # file names may not be valid Unicode


def write_report(path: str | os.PathLike[str], report: Report, form: str = "html") -> None:
    """Write ``report`` to ``path``, whole or not at all; raises OutputError if that fails."""
    text = render(report, form)
    with writing_text(path) as stream:
        stream.write(text)


def is_report(path: Path) -> bool:
    """Whether the file ``path`` is a report, in any format."""
    with path.open("rb") as file:
        return MARK.encode() in file.read(MARK_WITHIN)
