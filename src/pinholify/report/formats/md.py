"""A report as Markdown: text and tables without pictures, to paste into an issue."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from pinholify.report.contents import Report
from pinholify.report.narrative import Section, facts, sections, subtitle, title


def render(report: Report) -> str:
    """``report`` as GitHub Markdown."""
    overview = report.overview
    parts = [f"<!-- pinholify-report: {report.software} -->", f"# {escape(title(report))}", escape(subtitle(report))]
    parts += [f"**{escape(overview.sentence)}**"]
    parts.append("\n".join(f"- **{label}**: {value} ({meaning})" for label, value, meaning in facts(report)))
    parts += [escape(sentence) for sentence in report.missing]
    for section in sections(report):
        if section.tables or section.paragraphs:
            parts.append(_section(section))
        if section.key == "usage":
            parts += [f"### {s.title}\n\n```{s.language}\n{s.text}```" for s in report.usage]
    return "\n\n".join(parts) + "\n"


def _section(section: Section) -> str:
    tables = (table_text(table.header, table.rows, numeric=table.numeric) for table in section.tables)
    return "\n\n".join([f"## {section.title}", *map(escape, section.paragraphs), *tables])


def table_text(header: Sequence[str], rows: Iterable[Sequence[str]], *, numeric: bool = True) -> str:
    """A table in Markdown; all columns but the first are aligned to the right where they are ``numeric``."""
    rule = ["---", *["---:" if numeric else "---"] * (len(header) - 1)]
    lines = (map(escape, header), rule, *(map(escape, row) for row in rows))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def escape(text: str) -> str:
    """``text`` escaped so that Markdown shows it unchanged, on one line."""
    return re.sub(r"([\\`*_{}\[\]<>#|~])", r"\\\1", " ".join(text.split()))
