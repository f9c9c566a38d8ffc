"""The formats a report is written in. A new one is a module with ``render`` and one line here."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from pinholify.errors import InputError
from pinholify.io.files import writing_text
from pinholify.report.contents import Report
from pinholify.report.formats import html, json, markdown

FORMATS: dict[str, Callable[[Report], str]] = {
    "html": html.render,
    "md": markdown.render,
    "json": json.render,
}
"""A report as text, by the format's name, which is also its file's ending."""

MARK = "pinholify-report"
"""Stands near the start of every report, whatever its format."""

MARK_WITHIN = 2048  # bytes


def render(report: Report, form: str) -> str:
    """``report`` as text in the format ``form``; raises InputError for one that is not known."""
    if form not in FORMATS:
        raise InputError(f"'{form}' is no format of reports; the formats are: {', '.join(FORMATS)}")
    text = FORMATS[form](report)
    return text.encode("utf-8", "backslashreplace").decode("utf-8")  # names of files may hold what no text does


def write_report(path: str | os.PathLike[str], report: Report, form: str = "html") -> None:
    """Write ``report`` to ``path``, whole or not at all; raises OutputError where that fails."""
    text = render(report, form)
    with writing_text(path) as stream:
        stream.write(text)


def is_report(path: Path) -> bool:
    """Whether ``path`` is a report of ours, of any format."""
    with path.open("rb") as file:
        return MARK.encode() in file.read(MARK_WITHIN)
