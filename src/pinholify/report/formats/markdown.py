"""A report as Markdown: words and tables, to paste into a ticket; pictures are in the HTML."""

from __future__ import annotations

import re

from pinholify.report.contents import Report
from pinholify.report.narrative import Section, Table, facts, sections, subtitle, title


def render(report: Report) -> str:
    """The report as text in GitHub's Markdown."""
    overview = report.overview
    parts = [f"<!-- pinholify-report: {report.software} -->", f"# {escape(title(report))}", escape(subtitle(report))]
    parts += [f"**{escape(overview.sentence)}**"]
    parts.append("\n".join(f"- **{label}**: {value} ({meaning})" for label, value, meaning in facts(report)))
    parts += [escape(sentence) for sentence in report.missing]
    parts += [_section(section) for section in sections(report) if section.tables or section.paragraphs]
    snippets = (f"### {s.title}\n\n```{s.language}\n{s.text}```" for s in report.usage)
    at = next(i for i, part in enumerate(parts) if part.startswith("## How to use it"))
    return "\n\n".join([*parts[: at + 1], *snippets, *parts[at + 1 :]]) + "\n"


def _section(section: Section) -> str:
    return "\n\n".join([f"## {section.title}", *map(escape, section.paragraphs), *map(_table, section.tables)])


def _table(table: Table) -> str:
    rule = ["---", *["---:" if table.numeric else "---"] * (len(table.header) - 1)]
    rows = (map(escape, table.header), rule, *(map(escape, row) for row in table.rows))
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def escape(text: str) -> str:
    """``text`` so that Markdown shows it as it is: no markup, no HTML, no new line."""
    return re.sub(r"([\\`*_{}\[\]<>#|~])", r"\\\1", " ".join(text.split()))
