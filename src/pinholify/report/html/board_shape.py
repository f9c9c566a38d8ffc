"""The board's shape from above: arrows for shifts in its plane, discs for heights."""

from __future__ import annotations

import numpy as np

from pinholify.report.contents import Report
from pinholify.report.html.image_maps import arrow, framed
from pinholify.report.html.markup import Markup, drawing, element, polylines

SQUARE = 40.0  # side of a square in the drawing's units
MAX_DISC_RADIUS = 0.32  # radius, as a fraction of the distance between the corners drawn


def board_map(report: Report) -> Markup:
    """The corners of the board with their shifts and heights; nothing for a board without a shape of its own."""
    shape = report.board_shape
    if shape is None:
        return Markup("")
    low, high = shape.places.min(axis=0), shape.places.max(axis=0)
    spacing = float(np.diff(np.unique(shape.places[:, 0])).min())
    centres = SQUARE / spacing * (shape.places - low) + SQUARE
    tips = centres + SQUARE / spacing * shape.magnification * shape.shifts
    largest = max(float(np.abs(shape.heights).max()), 1e-12)
    radii = MAX_DISC_RADIUS * SQUARE * np.sqrt(np.abs(shape.heights) / largest)  # areas show heights
    discs = (
        element("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=f"{radius:.1f}", class_="low" if away else "high")
        for (x, y), radius, away in zip(centres, radii, shape.heights > 0, strict=True)
    )
    arrows = [arrow(start, tip) for start, tip in zip(centres, tips, strict=True)]
    width, height = SQUARE / spacing * (high - low) + 2 * SQUARE
    label = f"The board from above: shifts of its corners drawn {shape.magnification:g} times as long, and heights"
    drawn = drawing((width, height), *discs, polylines(arrows, "arrow", stroke_width=1.6), label=label)
    return framed(drawn)
