"""The page of a reproduction: as Markdown next to its figures, and as one HTML file."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path

from pinholify import __version__
from pinholify.report.formats.md import table_text
from pinholify.reproduction.chain import Reproduced
from pinholify.reproduction.drawing import pinhole_drawing
from pinholify.reproduction.findings import Finding, findings
from pinholify.reproduction.tables import Table, all_tables

TITLE = "How to turn your camera into a perfect pinhole model, reproduced"
INTRODUCTION = (
    "De Boi, Pathak, Oliveira and Penne (2023) turn a camera into a pinhole camera with a Gaussian process trained on "
    "one photograph of a checkerboard. Their photographs are not public. Here their six cameras are simulated: boards "
    "are ray-traced through each lens with blur and sensor noise, their corners are detected in the pixels, and the "
    "paper's tables and figures are recomputed and compared with the published numbers. The parameters of lenses, blur "
    "and noise were fixed, each with its reason, before the first calibration."
)
QUICK = "This is the quick version, with smaller images and fewer boards than the paper's, so errors in px differ."
IMAGES_CAPTION = (
    "One row per data set, each with a board other than the reference. From left to right: the photograph; its corners "
    "in the virtual plane with the best-fit lines of rows and columns and, in red, the magnified deviations; the board "
    "straightened by OpenCV's five-parameter model; by the paper's method, splatted onto the plane of the reference "
    "board; and by ours, resampled to a view along the optical axis where the map is known to 1 px."
)
PINHOLE_CAPTION = (
    "The lines of sight of 100 pixels, each fitted to its points on all boards (constant mean), to scale, in units of "
    "f. Next to each, at a separate scale: where the lines cross the plane through the origin (+), in one point if the "
    "camera were a perfect pinhole."
)
HOW_TO_TURN = "Drag or use the arrow keys to rotate, the wheel or + and − to zoom on the origin, double-click to reset."


def markdown_page(results: Sequence[Reproduced], *, quick: bool, images: str, pinholes: str) -> str:
    """The page as Markdown; ``images`` and ``pinholes`` are the paths of the figures relative to it."""
    parts = [f"# {TITLE}", INTRODUCTION, *([QUICK] if quick else []), "## What agrees, and what does not"]
    parts.append("\n".join(_finding_line(f, "**") for f in findings(results)))
    for table in all_tables(results):
        parts += [f"## {table.title}", table_text(table.header, table.rows), table.note]
    parts += ["## Figures", f"![{IMAGES_CAPTION}]({images})", IMAGES_CAPTION]
    parts += [f"![{PINHOLE_CAPTION}]({pinholes})", PINHOLE_CAPTION, f"Made by pinholify {__version__}."]
    return "\n\n".join(parts) + "\n"


def _finding_line(finding: Finding, strong: str) -> str:
    verdict = "agrees" if finding.agrees else "differs"
    return f"- {strong}{finding.claim}: {verdict}.{strong} {finding.text}"



def html_page(results: Sequence[Reproduced], *, quick: bool, images: Path, pinholes: Path) -> str:
    """The page as one HTML file with figures, style and rotating lines of sight; it loads nothing."""
    body = [f"<h1>{escape(TITLE)}</h1>", _paragraph(INTRODUCTION), *([_paragraph(QUICK)] if quick else [])]
    body += ["<h2>What agrees, and what does not</h2>", "<ul>", *map(_html_finding, findings(results)), "</ul>"]
    body += map(_html_table, all_tables(results))
    body += ["<h2>Figures</h2>", _picture(images, IMAGES_CAPTION), _picture(pinholes, PINHOLE_CAPTION)]
    body += ["<h2>Lines of sight in 3D</h2>", _paragraph(HOW_TO_TURN), _pencils(results)]
    body += [_paragraph(f"Made by pinholify {__version__}.", "note")]
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{escape(TITLE)}</title>'
    style = f"<style>\n{_resource('style.css')}</style>"
    start = f'<!doctype html>\n<html lang="en">\n<head>{head}\n{style}</head>\n<body>\n'
    return start + "\n".join(body) + "\n</body>\n</html>\n"


def _paragraph(text: str, kind: str = "text") -> str:
    return f'<p class="{kind}">{escape(text)}</p>'


def _html_finding(finding: Finding) -> str:
    verdict = "agrees" if finding.agrees else "differs"
    return f"<li><strong>{escape(finding.claim)}: {verdict}.</strong> {escape(finding.text)}</li>"


def _html_table(table: Table) -> str:
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in table.header)
    rows = "\n".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    inner = f"<caption>{escape(table.title)}</caption>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>"
    return f'<div class="scroll"><table>{inner}</table></div>\n{_paragraph(table.note, "note")}'


def _picture(path: Path, caption: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    text = escape(caption)
    image = f'<img alt="{text}" src="data:image/png;base64,{data}">'
    return f'<figure>{image}<figcaption class="note">{text}</figcaption></figure>'


def _pencils(results: Sequence[Reproduced]) -> str:
    """One canvas per data set, the lines as data, and the script that rotates them."""
    canvases, data = [], []
    for result in results:
        evaluation = result.paper.evaluation
        if evaluation.lines is None:
            continue
        drawing = pinhole_drawing(evaluation.lines, evaluation.calibration.camera.intrinsics.f)
        data.append({"segments": drawing.segments.round(6).tolist()})
        title = escape(result.dataset.title)
        canvas = f'<canvas class="pencil" tabindex="0" aria-label="Lines of sight: {title}"></canvas>'
        canvases.append(f'<figure>{canvas}<figcaption>{title} <span class="zoom"></span></figcaption></figure>')
    lines = json.dumps(data, separators=(",", ":"))
    return (
        f'<div class="pencils">{"".join(canvases)}</div>\n'
        f'<script type="application/json" id="pinhole-lines">{lines}</script>\n'
        f"<script>\n{_resource('rotator.js')}</script>"
    )


def _resource(name: str) -> str:
    return resources.files("pinholify.reproduction").joinpath(name).read_text(encoding="utf-8")
