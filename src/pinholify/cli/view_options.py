"""The options that describe a view, and the straightener made from them."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pinholify.cli import options
from pinholify.rectification.options import KEPT, VIEWS, ViewKind, ViewOptions, YawPitchRoll

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.rectification.straightener import Straightener

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
MIN_SHARE_SAID = 0.0005  # share outside of a view that is reported

FLAT_VIEWS = {name: kind for name, kind in VIEWS.items() if kind.surface == "plane"}


def straightener_of(camera: Path, wanted: ViewOptions, method: str) -> Straightener:
    """The straightener from the camera in a file to the view ``wanted``; prints what that leaves out."""
    from pinholify.io.camera_file import read_camera
    from pinholify.rectification.straightener import Straightener

    straightener = Straightener(read_camera(camera).camera, wanted, method)
    for sentence in _left_out(straightener):
        options.say(f"note: {sentence}")
    return straightener


def _left_out(straightener: Straightener) -> list[str]:
    """Sentences on what the view leaves out although the options did not ask for it."""
    from pinholify.rectification.views import share_outside, shows_nothing

    camera, view, wanted = straightener.camera, straightener.view, straightener.options
    if VIEWS[wanted.name].face is not None:
        black = shows_nothing(camera, view, wanted.max_std)
        return ["the camera sees nothing of this view: its pictures are black"] if black else []
    if wanted.fov is not None or wanted.keep != "all":
        return []
    outside = share_outside(camera, view, wanted.max_std)
    wider = "--fov, or --view cylindrical or equirectangular, shows more"
    return [f"{100 * outside:.1f} % of the known part of the photograph lies outside the view; {wider}"] * (
        outside >= MIN_SHARE_SAID
    )


def turn(text: str) -> YawPitchRoll:
    """Parse a rotation such as 30,-10 or 0,0,90 as (yaw, pitch, roll) in degrees; raises BadParameter."""
    if re.fullmatch(rf"{NUMBER}(\s*,\s*{NUMBER}){{0,2}}", text.strip()) is None:
        raise click.BadParameter(f"invalid rotation '{text}': write YAW[,PITCH[,ROLL]] in degrees, e.g. 30,-10,0")
    yaw, pitch, roll = ([float(number) for number in text.split(",")] + [0.0, 0.0])[:3]
    return yaw, pitch, roll


OPTIONS = (
    click.option("--size", type=options.size, metavar="WxH", help="Size of the view in px; by default the image's."),
    click.option(
        "--turn",
        type=turn,
        default="0,0,0",
        metavar="YAW[,PITCH[,ROLL]]",
        help="Turn the view, in degrees: to the right, upwards, clockwise.",
    ),
    click.option(
        "--fov",
        type=click.FloatRange(min=0, min_open=True, max=360),
        help="Horizontal field of view in degrees; by default the view is fitted according to --keep.",
    ),
    click.option(
        "--keep",
        type=click.Choice(list(KEPT)),
        default="all",
        show_default=True,
        help=options.explained(KEPT),
    ),
    click.option(
        "--max-std",
        type=click.FloatRange(min=0, min_open=True),
        help="Show pixels whose map has at most this standard deviation, in px, instead of the camera's own limit.",
    ),
)


def view_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add all view options; the command receives them as one argument ``view``, a :class:`ViewOptions`."""
    return _with_options(function, VIEWS)


def flat_view_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the same options, limited to views that are pinhole cameras."""
    return _with_options(function, FLAT_VIEWS)


def _with_options(function: Callable[..., Any], views: Mapping[str, ViewKind]) -> Callable[..., Any]:
    @functools.wraps(function)
    def wrapped(**given: Any) -> Any:
        view = ViewOptions(**{field.name: given.pop(field.name) for field in fields(ViewOptions)})
        return function(view=view, **given)

    names = click.option(
        "--view",
        "name",
        type=click.Choice(list(views)),
        default="camera",
        show_default=True,
        metavar="NAME",
        help=options.explained({name: kind.shows for name, kind in views.items()}),
    )
    for option in reversed((names, *OPTIONS)):
        wrapped = option(wrapped)
    return wrapped


def view_json(straightener: Straightener) -> dict[str, Any]:
    """The JSON object of a view; its ``k`` (3, 3) takes coordinates on its ``surface`` to pixels."""
    view, name = straightener.view, straightener.options.name
    return {
        "name": name,
        "surface": VIEWS[name].surface,
        "size": view.size,
        "k": view.matrix.tolist(),
        "rotation": view.rotation.tolist(),
    }
