"""Drawings of straightness: frames with ruled lines, and the rows and columns of a board."""

from __future__ import annotations

import numpy as np

from pinholify.arrays import Floats
from pinholify.report.contents import Report
from pinholify.report.html.markup import Markup, drawing, element, joined, picture, polylines
from pinholify.report.pictures import Frame, Picture
from pinholify.report.straightness import Bends

BENDS = 400.0  # units of a drawing of bends
MARGIN = 0.08  # of the drawing


def frames(report: Report) -> Markup:
    """Each frame before and after straightening: side by side, or with a slider where scripts run."""
    return joined(_frame(i, frame) for i, frame in enumerate(report.frames))


def _frame(index: int, frame: Frame) -> Markup:
    before = _half(frame.before, frame.ruler_before, f"{frame.name} as photographed", "as photographed")
    after = _half(frame.after, frame.ruler_after, f"{frame.name} straightened", "straightened")
    slider = element(
        "input", type="range", min=0, max=100, value=50, step=1, id=f"slider-{index}", class_="slider", hidden=True,
        aria_label=f"{frame.name}: percentage shown before straightening",
    )
    style = f"--width:{frame.before.width}"
    name = element("p", frame.name, class_="name")
    return element("div", name, element("div", before, after, class_="halves"), slider, class_="compare", style=style)


def _half(image: Picture, ruler: Floats, alt: str, tag: str) -> Markup:
    size = (image.width, image.height)
    lines = [line * size for line in ruler if np.isfinite(line).all()]
    parts = [polylines(lines, f"ruler {rim}") for rim in ("rim", "")] if lines else []
    return element("figure", picture(image, alt), drawing(size, *parts), element("figcaption", tag), class_="half")


def bends(report: Report) -> Markup:
    """The rows and columns of one board, in the photograph and in the virtual plane."""
    lines = report.straightness
    return element(
        "div",
        _bends(lines.before, "in the photograph", f"Rows and columns of {lines.example} bend in the photograph"),
        _bends(lines.after, "in the virtual plane", f"Rows and columns of {lines.example} in the virtual plane"),
        class_="pair",
    )


def _bends(board: Bends, tag: str, label: str) -> Markup:
    points = np.concatenate(board.straight)
    inner = BENDS * (1 - 2 * MARGIN)
    height = BENDS * 2 * MARGIN + inner * float(points[:, 1].max())

    def placed(lines: tuple[Floats, ...]) -> list[Floats]:
        return [BENDS * MARGIN + inner * line for line in lines]

    straight = [line[[0, -1]] for line in placed(board.straight)]
    content = [polylines(straight, "ruled"), polylines(placed(board.bent), "bent")]
    return element(
        "figure", drawing((BENDS, height), *content, label=label), element("figcaption", tag), class_="frame bends"
    )
