"""Functions that write HTML and SVG. All text and attributes are escaped here and nowhere else."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from html import escape

from pinholify.arrays import Floats
from pinholify.report.pictures import Picture

VOID = {"img", "input"}


class Markup(str):
    """Text that is already markup; any other text is escaped when it becomes part of an element."""

    __slots__ = ()


def element(name: str, *content: str, **attributes: str | float | bool | None) -> Markup:
    """The element ``name`` with ``content`` and ``attributes``; those that are None or False are left out.

    An underscore in an attribute's name stands for a hyphen; a final one is dropped.

    >>> element("p", "a < b", class_="note")
    '<p class="note">a &lt; b</p>'
    """
    start = f"<{name}{''.join(_attribute(key, value) for key, value in attributes.items())}>"
    return Markup(start if name in VOID else f"{start}{joined(content)}</{name}>")


def _attribute(key: str, value: str | float | bool | None) -> str:
    if value is None or value is False:
        return ""
    name = key.removesuffix("_").replace("_", "-").replace("viewbox", "viewBox")
    return f" {name}" if value is True else f' {name}="{escape(str(value))}"'


def joined(content: Iterable[str]) -> Markup:
    """Text and markup, concatenated and escaped."""
    return Markup("".join(part if isinstance(part, Markup) else escape(part) for part in content))


def picture(image: Picture, alt: str) -> Markup:
    """The picture as an element with its data embedded."""
    data = base64.b64encode(image.data).decode("ascii")
    source = f"data:{image.media_type};base64,{data}"
    return element("img", src=source, alt=alt, width=image.width, height=image.height)


def drawing(size: tuple[float, float], *content: str, label: str = "", class_: str = "") -> Markup:
    """An SVG of ``size`` in its own units; without a ``label`` it is hidden from screen readers as decoration."""
    named = {"role": "img", "aria_label": label} if label else {"aria_hidden": "true"}
    width, height = size
    return element("svg", *content, viewbox=f"0 0 {width:g} {height:g}", class_=class_ or None, **named)


def outline(polygons: Iterable[Floats], class_: str, **attributes: str | float) -> Markup:
    """Closed polygons (n, 2) as one path, with holes by the even-odd rule."""
    steps = "".join(f"M{_points(polygon)}Z" for polygon in polygons)
    return element("path", d=steps, class_=class_, fill_rule="evenodd", **attributes)


def polylines(lines: Iterable[Floats], class_: str, **attributes: str | float) -> Markup:
    """Open lines (n, 2) as one path."""
    return element("path", d="".join(f"M{_points(line)}" for line in lines), class_=class_, **attributes)


def dots(points: Floats, class_: str, **attributes: str | float) -> Markup:
    """Points (n, 2) as one path of round caps; the stroke width is their diameter."""
    return element("path", d="".join(f"M{_point(p)}h0" for p in points), class_=class_, **attributes)


def _points(line: Floats) -> str:
    return "L".join(_point(point) for point in line)


def _point(point: Floats) -> str:
    x, y = point
    return f"{_short(x)},{_short(y)}"


def _short(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")
