"""The scene on the page: a still drawing, which a script replaces with one that can be rotated."""

from __future__ import annotations

import json

import numpy as np

from pinholify.arrays import Floats
from pinholify.report.contents import Report
from pinholify.report.html.markup import Markup, dots, drawing, element, joined, outline, polylines
from pinholify.report.scene import Scene

YAW, PITCH = 0.65, 0.35  # of the first view, radians
STILL = (800.0, 480.0)
FILL = 0.45  # initial extent of the scene from its centre, as a fraction of the drawing's width and height
CROSSINGS = 300.0
HELP = "Drag to rotate. Keyboard: arrow keys rotate, + and − zoom, 0 resets."


def turning_scene(report: Report) -> Markup:
    """The still drawing, canvas and buttons, and a drawing of where the lines pass the centre."""
    scene = report.scene
    canvas = element(
        "canvas", tabindex=0, hidden=True, role="img", aria_label=f"{_label(scene)}. {HELP}",
    )
    buttons = element("div", *_buttons(bool(len(scene.lines))), class_="controls", hidden=True)
    hint = element("p", HELP, class_="hint", hidden=True)
    name = element("p", class_="pointed", aria_live="polite")
    stage = element("div", _still(scene), canvas, name, class_="stage")
    data = element("script", Markup(_data(scene)), type="application/json")
    return joined([element("div", stage, buttons, hint, data, class_="scene"), _crossings(scene)])


def _label(scene: Scene) -> str:
    lines = f" and {len(scene.lines)} lines of sight" if len(scene.lines) else ""
    return f"The camera, {len(scene.names)} boards{lines} in three dimensions"


def _buttons(lines: bool) -> list[Markup]:
    names = [("left", "◀", "Turn left"), ("right", "▶", "Turn right"), ("up", "▲", "Tilt up")]
    names += [("down", "▼", "Tilt down"), ("in", "+", "Zoom in"), ("out", "−", "Zoom out"), ("reset", "Reset", "Reset")]
    buttons = [
        element("button", sign, type="button", data_does=does, aria_label=label, title=label)
        for does, sign, label in names
    ]
    if lines:
        shown = {"type": "button", "data_does": "lines", "aria_pressed": "true"}
        buttons.append(element("button", "Lines of sight", **shown))
    return buttons


def _data(scene: Scene) -> str:
    """The scene as JSON for the script, escaped so that no photograph's name can end the script element."""
    parts = {
        "names": scene.names,
        "boards": _rounded(scene.boards),
        "frustum": _rounded(scene.frustum),
        "lines": _rounded(scene.lines),
        "middle": _rounded(_middle(scene)),
        "reach": _rounded(reach(scene)),
        "fill": FILL,
        "yaw": YAW,
        "pitch": PITCH,
    }
    text = json.dumps(parts, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _rounded(points: Floats) -> object:
    return np.round(points, 3).tolist()


def _still(scene: Scene) -> Markup:
    """The initial view, for print and where no script runs."""
    middle = _middle(scene)
    scale = FILL * float((np.array(STILL) / reach(scene)).min())

    def placed(points: Floats) -> Floats:
        flat, _ = turned(points.reshape(-1, 3) - middle)
        return np.asarray(flat * scale + np.array(STILL) / 2).reshape(*points.shape[:-1], 2)

    farthest_first = np.argsort(-turned(scene.boards.mean(axis=1) - middle)[1])
    corner_rays = np.stack([np.zeros_like(scene.frustum), scene.frustum], axis=1)
    content = [
        polylines(placed(scene.lines), "sight"),
        *(outline([quad], "board") for quad in placed(scene.boards[farthest_first])),
        polylines(placed(corner_rays), "camera"),
        outline([placed(scene.frustum)], "camera"),
        dots(placed(np.zeros((1, 3))), "centre"),
    ]
    return drawing(STILL, *content, label=_label(scene), class_="still")


def _everything(scene: Scene) -> Floats:
    return np.concatenate([scene.boards.reshape(-1, 3), scene.frustum, np.zeros((1, 3))])


def _middle(scene: Scene) -> Floats:
    everything = _everything(scene)
    return np.asarray((everything.min(axis=0) + everything.max(axis=0)) / 2)


def reach(scene: Scene) -> Floats:
    """Largest distances (2,) of the scene from its centre, across and down, in the initial view."""
    return np.asarray(np.abs(turned(_everything(scene) - _middle(scene))[0]).max(axis=0))


def turned(points: Floats) -> tuple[Floats, Floats]:
    """Points (n, 3) in the initial view: across and down (n, 2), and depth (n,), as the script's ``turned``."""
    x, y, z = points.T
    across, depth = np.cos(YAW) * x - np.sin(YAW) * z, np.sin(YAW) * x + np.cos(YAW) * z
    down = np.cos(PITCH) * y - np.sin(PITCH) * depth
    return np.column_stack([across, down]), np.sin(PITCH) * y + np.cos(PITCH) * depth


def _crossings(scene: Scene) -> Markup:
    """A drawing of where the lines of sight pass the camera's centre."""
    if not len(scene.crossings):
        return Markup("")
    middle = CROSSINGS / 2
    far = max(float(np.quantile(np.abs(scene.crossings), 0.98)), 1e-12)
    places = middle * (1.0 + 0.9 * np.clip(scene.crossings / far, -1.1, 1.1))
    cross = [
        np.array([[middle - 10, middle], [middle + 10, middle]]),
        np.array([[middle, middle - 10], [middle, middle + 10]]),
    ]
    extent = f"{100 * far / 0.9:.2g} % of f from the centre to the edge"
    label = f"Where {len(scene.crossings)} lines of sight pass the camera's centre; {extent}"
    content = [polylines(cross, "cross"), dots(places, "speck", stroke_width=5)]
    square = drawing((CROSSINGS, CROSSINGS), *content, label=label)
    return element("figure", square, element("figcaption", extent), class_="frame crossings")
