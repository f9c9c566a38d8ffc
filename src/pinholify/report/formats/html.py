"""A report as a self-contained web page: style, scripts and pictures are embedded."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from string import Template

from pinholify.report.contents import Report
from pinholify.report.html.board_shape import board_map
from pinholify.report.html.boards import cards, error_bars, model_bars
from pinholify.report.html.image_maps import certainty_map, coverage_map, residual_map
from pinholify.report.html.lines import bends, frames
from pinholify.report.html.markup import Markup, element, joined
from pinholify.report.html.scene import turning_scene
from pinholify.report.narrative import Section, Table, facts, sections, subtitle, title

SCRIPTS = ("slider.js", "scene.js", "copy.js")


def snippets(report: Report) -> Markup:
    """Code to copy."""
    blocks = (
        element("div", element("h3", s.title), element("pre", element("code", s.text), tabindex=0), class_="snippet")
        for s in report.usage
    )
    return element("div", *blocks, class_="snippets")


FIGURES: dict[str, Callable[[Report], Markup]] = {
    "frames": frames,
    "errors": error_bars,
    "photographs": cards,
    "coverage": coverage_map,
    "certainty": certainty_map,
    "residuals": residual_map,
    "straightness": bends,
    "scene": turning_scene,
    "board-shape": board_map,
    "comparison": model_bars,
    "usage": snippets,
}
"""Functions that draw the figures of sections, by key."""

DRAWN_TABLES = ("photographs",)
"""Sections whose figure replaces their tables."""


def render(report: Report) -> str:
    """``report`` as HTML."""
    template = Template(_asset("page.html"))
    return template.substitute(
        generator=joined([report.software]),
        title=joined([title(report)]),
        style=_asset("style.css"),
        header=_header(report),
        sections=joined(_section(section, report) for section in sections(report)),
        scripts="\n".join(_asset(name) for name in SCRIPTS),
    )


def _asset(name: str) -> str:
    return resources.files("pinholify.report").joinpath("assets", name).read_text(encoding="utf-8")


def _header(report: Report) -> Markup:
    overview = report.overview
    verdict = element(
        "p",
        element("strong", overview.level.capitalize(), class_=f"level {overview.level}"),
        " ",
        element("span", _sentence(overview.headline)),
        class_="verdict",
    )
    remarks = (*overview.reasons, *([] if overview.next_board is None else [overview.next_board]))
    reasons = element("ul", *(element("li", _sentence(remark)) for remark in remarks), class_="reasons")
    tiles = (
        element("div", element("dt", label), element("dd", value, element("small", meaning)))
        for label, value, meaning in facts(report)
    )
    missing = element("ul", *(element("li", sentence) for sentence in report.missing), class_="missing")
    links = (element("li", element("a", s.title, href=f"#{s.key}")) for s in sections(report))
    return joined(
        [
            element("h1", title(report)),
            element("p", subtitle(report), class_="subtitle"),
            verdict,
            reasons if remarks else "",
            element("dl", *tiles, class_="facts"),
            missing if report.missing else "",
            element("nav", element("ol", *links), aria_label="Sections of this report"),
        ]
    )


def _sentence(clause: str) -> str:
    """``clause`` with a capital and a full stop."""
    return f"{clause[:1].upper()}{clause[1:]}."


def _section(section: Section, report: Report) -> Markup:
    draw = FIGURES.get(section.key)
    tables = () if section.key in DRAWN_TABLES else section.tables
    content = [
        element("h2", section.title, id=f"{section.key}-title"),
        element("div", *(element("p", text) for text in section.paragraphs), class_="words"),
        *map(_table, tables),
        element("div", draw(report), class_="figure") if draw else "",
        element("p", section.caption, class_="caption") if section.caption else "",
    ]
    return element("section", *content, id=section.key, aria_labelledby=f"{section.key}-title")


def _table(table: Table) -> Markup:
    head = element("tr", *(element("th", cell, scope="col") for cell in table.header))
    rows = (
        element("tr", element("th", first, scope="row"), *(element("td", cell) for cell in rest))
        for first, *rest in table.rows
    )
    caption = element("caption", table.caption)
    whole = element("table", caption, element("thead", head), element("tbody", *rows))
    kind = "table numeric" if table.numeric else "table pairs" if len(table.header) == 2 else "table"
    return element("div", whole, class_=kind, tabindex=0, role="region", aria_label=table.caption)
