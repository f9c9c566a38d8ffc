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
VIEWS = ("camera", "board", "cylindrical", "equirectangular", *FACES)
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"

VIEW_HELP = """camera: along the optical axis. board: straight at the reference board. cylindrical, equirectangular: all
around, for lenses beyond 120 degrees. cube-front, -right, -back, -left, -up, -down: a face of a cube, square."""


@dataclass(frozen=True, slots=True)
class ViewChoice:
    """What the options said."""

    view: str
    size: tuple[int, int] | None
    turn: tuple[float, float, float]
    fov: float | None
    keep: str
    max_std: float | None

    def straightener(self, camera: Path, **more: Any) -> Straightener:
        """The straightener to this view of the camera in a file, said where it shows nothing; ``more`` are options."""
        from pinholify.io.camera_file import read_camera
        from pinholify.rectification.straightener import Straightener
        from pinholify.rectification.views import shows_nothing

        straightener = Straightener(
            read_camera(camera).camera,
            self.view,
            size=self.size,
            turn=self.turn,
            fov=self.fov,
            keep=self.keep,
            max_std=self.max_std,
            **more,
        )
        fitted = self.view not in FACES and self.fov is None
        if not fitted and shows_nothing(straightener.camera, straightener.view, self.max_std):
            options.say("note: the camera sees nothing of this view: its pictures are black")
        return straightener


def turn(text: str) -> tuple[float, float, float]:
    """Degrees (yaw, pitch, roll) of a text such as 30,-10 or 0,0,90; raises BadParameter."""
    if re.fullmatch(rf"{NUMBER}(\s*,\s*{NUMBER}){{0,2}}", text.strip()) is None:
        raise click.BadParameter(f"'{text}' is no turn; write degrees YAW,PITCH,ROLL, for example 30,-10,0")
    yaw, pitch, roll = ([float(number) for number in text.split(",")] + [0.0, 0.0])[:3]
    return yaw, pitch, roll


OPTIONS = (
    click.option(
        "--view", type=click.Choice(VIEWS), default="camera", show_default=True, metavar="NAME", help=VIEW_HELP
    ),
    click.option("--size", type=options.size, metavar="WxH", help="Size of the result in px; the image's by default."),
    click.option(
        "--turn",
        type=turn,
        default="0,0,0",
        metavar="YAW,PITCH,ROLL",
        help="Turn the view by degrees: to the right, upwards, clockwise.",
    ),
    click.option(
        "--fov",
        type=click.FloatRange(min=0, min_open=True, max=360),
        help="Horizontal field of view in degrees; by default all that is known fits in.",
    ),
    click.option(
        "--keep",
        type=click.Choice(["all", "valid"]),
        default="all",
        show_default=True,
        help="Show all that is known, or the largest picture without black in it.",
    ),
    click.option(
        "--max-std",
        type=click.FloatRange(min=0, min_open=True),
        help="Show what is known to this many px, instead of the camera's domain.",
    ),
)


def view_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """All of them; the command gets one argument ``choice``, a :class:`ViewChoice`."""

    @functools.wraps(function)
    def wrapped(**given: Any) -> Any:
        choice = ViewChoice(*(given.pop(name) for name in ViewChoice.__slots__))
        return function(choice=choice, **given)

    for option in reversed(OPTIONS):
        wrapped = option(wrapped)
    return wrapped
