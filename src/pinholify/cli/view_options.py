"""The options that describe a view, and the straightener made from them."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pinholify.cli import options

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.rectification.straightener import Straightener

FACES = tuple(f"cube-{face}" for face in ("front", "right", "back", "left", "up", "down"))
FLAT_VIEWS = ("camera", "board", *FACES)
VIEWS = ("camera", "board", "cylindrical", "equirectangular", *FACES)
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
LEAST_SAID = 0.0005  # share outside of a view that is reported

FLAT_HELP = """camera: along the optical axis. board: straight at the reference board. cube-front, -right, -back, -left,
-up, -down: a square face of a cube."""
VIEW_HELP = FLAT_HELP + " cylindrical, equirectangular: all around, for lenses beyond 120 degrees."


@dataclass(frozen=True, slots=True)
class ViewChoice:
    """The values of the options."""

    view: str
    size: tuple[int, int] | None
    turn: tuple[float, float, float]
    fov: float | None
    keep: str
    max_std: float | None

    def options(self) -> dict[str, Any]:
        """The keyword arguments of ``Straightener`` and ``export_view``, all but the view's name."""
        return {name: getattr(self, name) for name in ViewChoice.__slots__ if name != "view"}

    def straightener(self, camera: Path, **more: Any) -> Straightener:
        """The straightener from the camera in a file to this view; prints what it leaves out. ``more`` goes to it."""
        from pinholify.io.camera_file import read_camera
        from pinholify.rectification.straightener import Straightener

        straightener = Straightener(read_camera(camera).camera, self.view, **self.options(), **more)
        for sentence in self._left_out(straightener):
            options.say(f"note: {sentence}")
        return straightener

    def _left_out(self, straightener: Straightener) -> list[str]:
        """Sentences on what the view leaves out although the options did not ask for it."""
        from pinholify.rectification.views import share_outside, shows_nothing

        camera, view = straightener.camera, straightener.view
        if self.view in FACES:
            black = shows_nothing(camera, view, self.max_std)
            return ["the camera sees nothing of this view: its pictures are black"] if black else []
        if self.fov is not None or self.keep != "all":
            return []
        outside = share_outside(camera, view, self.max_std)
        wider = "--fov, or --view cylindrical or equirectangular, shows more"
        return [f"{100 * outside:.1f} % of the known part of the photograph lies outside the view; {wider}"] * (
            outside >= LEAST_SAID
        )


def turn(text: str) -> tuple[float, float, float]:
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
        type=click.Choice(["all", "valid"]),
        default="all",
        show_default=True,
        help="all: what is known up to 65 degrees from the view's axis (70 if that takes in all corners); valid: the "
        "largest picture without black.",
    ),
    click.option(
        "--max-std",
        type=click.FloatRange(min=0, min_open=True),
        help="Show pixels whose map has at most this standard deviation, in px, instead of the camera's own limit.",
    ),
)


def view_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add all view options; the command receives them as one argument ``choice``, a :class:`ViewChoice`."""
    return _with_options(function, VIEWS, VIEW_HELP)


def flat_view_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the same options, limited to views that are pinhole cameras."""
    return _with_options(function, FLAT_VIEWS, FLAT_HELP)


def _with_options(function: Callable[..., Any], views: tuple[str, ...], view_help: str) -> Callable[..., Any]:
    @functools.wraps(function)
    def wrapped(**given: Any) -> Any:
        choice = ViewChoice(*(given.pop(name) for name in ViewChoice.__slots__))
        return function(choice=choice, **given)

    view = click.option(
        "--view", type=click.Choice(views), default="camera", show_default=True, metavar="NAME", help=view_help
    )
    for option in reversed((view, *OPTIONS)):
        wrapped = option(wrapped)
    return wrapped


def view_json(straightener: Straightener) -> dict[str, Any]:
    """The JSON object of a view; its ``k`` (3, 3) takes coordinates on its ``surface`` to pixels."""
    view = straightener.view
    return {
        "name": straightener.view_name,
        "surface": type(view.surface).__name__.lower(),
        "size": view.size,
        "k": view.matrix.tolist(),
        "rotation": view.rotation.tolist(),
    }
