"""The options by which commands are told of a view, and the straightener for them."""

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
LEAST_SAID = 0.0005  # share outside of a view of which is told

FLAT_HELP = """camera: along the optical axis. board: straight at the reference board. cube-front, -right, -back, -left,
-up, -down: a face of a cube, square."""
VIEW_HELP = FLAT_HELP + " cylindrical, equirectangular: all around, for lenses beyond 120 degrees."


@dataclass(frozen=True, slots=True)
class ViewChoice:
    """What the options said."""

    view: str
    size: tuple[int, int] | None
    turn: tuple[float, float, float]
    fov: float | None
    keep: str
    max_std: float | None

    def options(self) -> dict[str, Any]:
        """The keyword arguments by which the library is told the same, but for the view's name."""
        return {name: getattr(self, name) for name in ViewChoice.__slots__ if name != "view"}

    def straightener(self, camera: Path, **more: Any) -> Straightener:
        """The straightener to this view of the camera in a file, said what it leaves out; ``more`` are options."""
        from pinholify.io.camera_file import read_camera
        from pinholify.rectification.straightener import Straightener

        straightener = Straightener(read_camera(camera).camera, self.view, **self.options(), **more)
        for sentence in self._left_out(straightener):
            options.say(f"note: {sentence}")
        return straightener

    def _left_out(self, straightener: Straightener) -> list[str]:
        """What nobody asked to be left out."""
        from pinholify.rectification.views import share_outside, shows_nothing

        camera, view = straightener.camera, straightener.view
        if self.view in FACES:
            black = shows_nothing(camera, view, self.max_std)
            return ["the camera sees nothing of this view: its pictures are black"] if black else []
        if self.fov is not None or self.keep != "all":
            return []
        outside = share_outside(camera, view, self.max_std)
        wider = "--fov, or --view cylindrical or equirectangular, shows more"
        return [f"{outside:.1%} of what is known of the photograph lies outside the view; {wider}"] * (
            outside >= LEAST_SAID
        )


def turn(text: str) -> tuple[float, float, float]:
    """Degrees (yaw, pitch, roll) of a text such as 30,-10 or 0,0,90; raises BadParameter."""
    if re.fullmatch(rf"{NUMBER}(\s*,\s*{NUMBER}){{0,2}}", text.strip()) is None:
        raise click.BadParameter(f"'{text}' is no turn; write degrees YAW[,PITCH[,ROLL]], for example 30,-10,0")
    yaw, pitch, roll = ([float(number) for number in text.split(",")] + [0.0, 0.0])[:3]
    return yaw, pitch, roll


OPTIONS = (
    click.option("--size", type=options.size, metavar="WxH", help="Size of the view in px; the image's by default."),
    click.option(
        "--turn",
        type=turn,
        default="0,0,0",
        metavar="YAW[,PITCH[,ROLL]]",
        help="Turn the view by degrees: to the right, upwards, clockwise.",
    ),
    click.option(
        "--fov",
        type=click.FloatRange(min=0, min_open=True, max=360),
        help="Horizontal field of view in degrees; by default the view is fitted as --keep says.",
    ),
    click.option(
        "--keep",
        type=click.Choice(["all", "valid"]),
        default="all",
        show_default=True,
        help="Show all that is known up to 65 degrees from the view's axis (70 where corners end there), or the "
        "largest picture without black in it.",
    ),
    click.option(
        "--max-std",
        type=click.FloatRange(min=0, min_open=True),
        help="Show where the map is known to this many px, instead of to the camera's own limit.",
    ),
)


def view_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """All of them; the command gets one argument ``choice``, a :class:`ViewChoice`."""
    return _with_options(function, VIEWS, VIEW_HELP)


def flat_view_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same, of views that are pinhole cameras."""
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
    """What ``--json`` says of the view: its ``k`` (3, 3) px takes coordinates on its ``surface`` to pixels."""
    view = straightener.view
    return {
        "name": straightener.view_name,
        "surface": type(view.surface).__name__.lower(),
        "size": view.size,
        "k": view.matrix.tolist(),
        "rotation": view.rotation.tolist(),
    }
