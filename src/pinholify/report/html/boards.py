"""Photographs on the page: the list of their errors, and a card for each."""

from __future__ import annotations

import numpy as np

from pinholify.arrays import Floats
from pinholify.report.boards import BoardEntry
from pinholify.report.contents import Report
from pinholify.report.html.markup import Markup, dots, drawing, element, joined, picture, polylines
from pinholify.report.narrative import model_name, residual_scale, state
from pinholify.report.numerals import angle, number, px

LARGEST_DOT, SMALLEST_DOT = 1 / 62, 1 / 200  # diameter of a corner, as a fraction of the photograph's width
DOT_SPACING = 0.4  # diameter of a corner between these limits, as a fraction of the corners' spacing
RESIDUAL = 1 / 170  # width of a residual's line, as a fraction of the photograph's width
RING = 12  # segments of a circle


def error_bars(report: Report) -> Markup:
    """One line per photograph: its name, a bar and its error."""
    longest = max([entry.worst_px for entry in report.boards if entry.worst_px is not None], default=1.0)
    scale = 100.0 / max(longest, report.overview.floor_px, 1e-9)
    rows = (_bar(i, entry, report.overview.floor_px, scale) for i, entry in enumerate(report.boards))
    return element("ol", *rows, class_="bars")


def model_bars(report: Report) -> Markup:
    """One line per model: the bar is its held-out error, the dot its in-sample error."""
    compared = report.comparison
    scores: list[tuple[str, float | None, float | None]]
    scores = [(f"pinholify, {compared.method}", compared.heldout_px, compared.insample_px)]
    scores += [(model_name(name), score.heldout_px, score.insample_px) for name, score in compared.models.items()]
    known = [value for _, *errors in scores for value in errors if value is not None]
    if compared.heldout_px is None or not compared.models:
        return Markup("")
    scale = 100.0 / max(*known, report.overview.floor_px, 1e-9)
    rows = []
    for name, heldout, insample in scores:
        style = f"--rms:{(heldout or 0) * scale:.1f}%;--floor:{report.overview.floor_px * scale:.1f}%"
        style += "" if insample is None else f";--worst:{insample * scale:.1f}%"
        bar = element("span", element("i"), class_="bar", style=style)
        rows.append(element("li", element("span", name), bar, element("span", px(heldout), class_="value")))
    return element("ol", *rows, class_="bars models", aria_hidden="true")


def _bar(index: int, entry: BoardEntry, floor: float, scale: float) -> Markup:
    name = element("a", entry.name, href=f"#photograph-{index}", title=entry.name)
    if entry.rms_px is None or entry.worst_px is None:
        return element("li", name, element("span", state(entry), class_="aside"), class_="left-out")
    style = f"--rms:{entry.rms_px * scale:.1f}%;--worst:{entry.worst_px * scale:.1f}%;--floor:{floor * scale:.1f}%"
    bar = element("span", element("i"), class_="bar", style=style, aria_hidden="true")
    worst = element("small", f" worst {number(entry.worst_px, 2)} px")
    value = element("span", f"{number(entry.rms_px, 2)} px", worst, class_="value")
    stands_out = "wrong" if entry.ratio is not None or entry.crowded else "left-out" if not entry.included else None
    return element("li", name, bar, value, class_=stands_out)


def cards(report: Report) -> Markup:
    """One card per photograph: thumbnail, corners, residuals and numbers."""
    scale = residual_scale(report)
    each = (_card(i, entry, report.image_size, scale) for i, entry in enumerate(report.boards))
    return element("div", *each, class_="photographs")


def _card(index: int, entry: BoardEntry, size: tuple[int, int], scale: float) -> Markup:
    shown = _overlay(entry, size, scale)
    photograph = picture(entry.thumbnail, "") if entry.thumbnail is not None else ""
    frame = element(
        "div", photograph, shown, class_="photograph" if photograph else "photograph blank",
        style=f"aspect-ratio:{size[0]}/{size[1]}",
    )
    caption = element("figcaption", element("strong", entry.name), _badge(entry), _numbers(entry))
    return element("figure", frame, caption, id=f"photograph-{index}")


def _overlay(entry: BoardEntry, size: tuple[int, int], scale: float) -> Markup:
    """Corners and residuals over a photograph, each drawn twice, first as a dark outline."""
    width = size[0]
    counted = entry.corners[entry.counted]
    arrows = np.stack([counted, counted + scale * entry.residuals[entry.counted]], axis=1)
    dot = _dot(entry.corners, width)
    rings = [_ring(corner, 0.7 * dot) for corner in entry.corners[~entry.counted & ~entry.wrong]]
    crosses = [line for corner in entry.corners[entry.wrong] for line in _cross(corner, dot)]
    parts = []
    for rim, wider in (("rim", 1.9), ("", 1.0)):
        parts += [
            dots(counted, f"corner {rim}", stroke_width=_width(dot * (1 + (wider - 1) / 2))),
            polylines(rings, f"ring {rim}", stroke_width=_width(RESIDUAL * width * wider)),
            polylines(crosses, f"misplaced {rim}", stroke_width=_width(RESIDUAL * width * wider)),
            polylines(arrows, f"residual {rim}", stroke_width=_width(RESIDUAL * width * wider)),
        ]
    found = f"{len(entry.corners)} corners found, {len(counted)} used" if len(entry.corners) else "no board found"
    return drawing(size, *parts, label=f"{entry.name}: {found}")


def _dot(corners: Floats, width: float) -> float:
    """The diameter of a corner, smaller where corners are close together."""
    spacing = float(np.sqrt(np.ptp(corners, axis=0).prod() / len(corners))) if len(corners) else 0.0
    return float(np.clip(DOT_SPACING * spacing, SMALLEST_DOT * width, LARGEST_DOT * width))


def _width(value: float) -> str:
    return f"{value:.2f}"


def _ring(centre: Floats, radius: float) -> Floats:
    turn = np.linspace(0.0, 2.0 * np.pi, RING + 1)
    return np.asarray(centre + radius * np.column_stack([np.cos(turn), np.sin(turn)]))


def _cross(centre: Floats, reach: float) -> tuple[Floats, Floats]:
    """The two strokes of a cross."""
    slope = reach * np.array([[-1.0, -1.0], [1.0, 1.0]])
    return centre + slope, centre + slope * [1.0, -1.0]


def _badge(entry: BoardEntry) -> Markup:
    badges = [element("span", state(entry), class_="badge in" if entry.included else "badge out")]
    if entry.ratio is not None:
        badges.append(element("span", f"suspicious: {entry.ratio:.1f} times the others' error", class_="badge wrong"))
    if entry.crowded:
        badges.append(element("span", "too many wrong corners", class_="badge wrong"))
    if entry.note:
        badges.append(element("span", entry.note, class_="badge out"))
    if entry.ambiguous_offset:
        badges.append(element("span", "visible part of the board assumed", class_="badge out"))
    return joined(badges)


def _numbers(entry: BoardEntry) -> Markup:
    dropped = f", {entry.dropped} wrong and left out" if entry.dropped else ""
    outside = int((~entry.counted & ~entry.wrong).sum())
    aside = f", {outside} not counted" if outside and entry.counted.any() else ""
    lines = [f"{len(entry.corners)} corners{aside}{dropped}"] if len(entry.corners) else []
    if entry.rms_px is not None:
        lines.append(f"{px(entry.rms_px)} RMS, worst {px(entry.worst_px)}")
    if entry.distance is not None:
        lines.append(f"{number(entry.distance, 1)} squares away, tilted {angle(entry.tilt_degrees)}")
    return joined(element("span", line, class_="line") for line in lines)
