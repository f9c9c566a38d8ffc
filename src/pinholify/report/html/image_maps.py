"""Maps drawn over the area of the image: coverage, standard deviation, residuals."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pinholify.arrays import Floats
from pinholify.report.contents import Report
from pinholify.report.html.markup import Markup, dots, drawing, element, joined, outline, polylines
from pinholify.report.maps import LEVELS
from pinholify.report.numerals import px

LAYER = 0.17  # opacity that each level of standard deviation adds
MAX_DOTS = 4000
CLOUD = 400.0  # side of the cloud's drawing, in its own units
CLOUD_REACH = 4.0  # standard deviations that the cloud shows at least
HEAD = 0.3  # length of an arrow's head, as a fraction of the arrow


def coverage_map(report: Report) -> Markup:
    """The areas of the boards, the camera's domain and the best next board."""
    size, coverage = report.image_size, report.coverage
    width = size[0]
    corners = np.concatenate([entry.corners[entry.counted] for entry in report.boards])
    boards = (outline([polygon], "layer", opacity=_layer(len(coverage.boards))) for polygon in coverage.boards)
    parts = [*boards, dots(_thinned(corners), "speck", stroke_width=width / 260)]
    parts.append(outline(coverage.believed, "believed", stroke_width=width / 240))
    if coverage.next_board is not None:
        dashes = f"{width / 60:.1f} {width / 90:.1f}"
        parts.append(outline([coverage.next_board], "next", stroke_width=width / 200, stroke_dasharray=dashes))
    label = f"Map of the image: corners cover the outlined {100 * coverage.share:.0f} % of it"
    return framed(drawing(size, *parts, label=label))


def _layer(count: int) -> str:
    """Opacity of the area of one of ``count`` boards, so that all of them together stay translucent."""
    return f"{float(np.clip(1.6 / max(count, 1), 0.03, 0.3)):.3f}"


def framed(*content: str) -> Markup:
    """``content`` in a frame."""
    return element("div", *content, class_="frame")


def _thinned(points: Floats) -> Floats:
    every = max(1, -(-len(points) // MAX_DOTS))
    return points[::every]


def certainty_map(report: Report) -> Markup:
    """Contours of the standard deviation, with their legend."""
    certainty = report.certainty
    layers = (outline(region, "layer", opacity=LAYER) for region in certainty.regions)
    domain = outline(report.coverage.believed, "believed", stroke_width=report.image_size[0] / 240)
    label = f"Map of the standard deviation over the image: median {px(certainty.inside_px)} in the camera's domain"
    return joined([framed(drawing(report.image_size, *layers, domain, label=label)), _legend(certainty.levels)])


def _legend(levels: tuple[float, ...]) -> Markup:
    """The range of standard deviations that each shade stands for."""
    names = [f"below {(levels or LEVELS)[0]:g} px"]
    names += [f"{low:g} – {high:g}" for low, high in pairwise(levels)]
    names += [f"above {level:g}" for level in levels[-1:]]
    items = (
        element("li", element("span", class_="swatch", style=f"--depth:{1 - (1 - LAYER) ** i:.3f}"), name)
        for i, name in enumerate(names)
    )
    return element("ul", *items, class_="legend")


def residual_map(report: Report) -> Markup:
    """Mean residuals over the image, and the cloud of all residuals."""
    field = report.residuals
    tips = field.centres + field.magnification * field.means
    arrows = [arrow(start, tip) for start, tip in zip(field.centres, tips, strict=True)]
    width = report.image_size[0]
    parts = [
        dots(field.centres, "speck", stroke_width=width / 200),
        polylines(arrows, "arrow", stroke_width=f"{width / 320:.2f}"),
    ]
    label = f"Mean residuals over the image, drawn {field.magnification:g} times as long"
    return element("div", framed(drawing(report.image_size, *parts, label=label)), _cloud(report), class_="pair wide")


def arrow(start: Floats, tip: Floats) -> Floats:
    """A polyline (6, 2) from ``start`` to ``tip`` and along the two strokes of the head."""
    back = HEAD * (start - tip)
    aside = np.array([-back[1], back[0]]) * 0.6
    return np.array([start, tip, tip + back + aside, tip, tip + back - aside])


def _cloud(report: Report) -> Markup:
    field = report.residuals
    spread = float(np.quantile(np.abs(field.all), 0.999)) if len(field.all) else 0.0
    reach = max(CLOUD_REACH * field.noise_px, spread, 1e-9)
    places = CLOUD / 2 * (1.0 + _thinned(np.clip(field.all / reach, -1.0, 1.0)))
    middle = CLOUD / 2
    rings = (
        element("circle", cx=middle, cy=middle, r=f"{middle * k * field.noise_px / reach:.1f}", class_="ring")
        for k in (1, 2, 3)
    )
    cross = [np.array([[middle, 0.0], [middle, CLOUD]]), np.array([[0.0, middle], [CLOUD, middle]])]
    content = [polylines(cross, "axis"), dots(places, "speck", stroke_width=4), *rings]
    label = f"Cloud of all residuals, up to {px(reach)} along each axis"
    return framed(drawing((CLOUD, CLOUD), *content, label=label))
