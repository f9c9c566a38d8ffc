"""The views there are, by name, and what can be asked of one. Imports nothing heavy, so that ``--help`` is instant."""

from __future__ import annotations

from dataclasses import dataclass

from pinholify.errors import InputError

YawPitchRoll = tuple[float, float, float]
"""Yaw to the right, pitch upwards and roll clockwise, in degrees, applied in this order."""

STRAIGHT_ON: YawPitchRoll = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ViewKind:
    """What a view ``shows``, in words, and the name of its ``surface``.

    ``face`` is the direction of a cube's face from that of the view ``camera``, and None for all other views.
    """

    shows: str
    surface: str = "plane"
    face: YawPitchRoll | None = None


_FACE = "a square face of a cube"
_AROUND = "all around, for lenses beyond 120 degrees"

VIEWS = {
    "camera": ViewKind("along the optical axis"),
    "board": ViewKind("straight at the reference board"),
    "cylindrical": ViewKind(_AROUND, "cylinder"),
    "equirectangular": ViewKind(_AROUND, "sphere"),
    "cube-front": ViewKind(_FACE, face=(0.0, 0.0, 0.0)),
    "cube-right": ViewKind(_FACE, face=(90.0, 0.0, 0.0)),
    "cube-back": ViewKind(_FACE, face=(180.0, 0.0, 0.0)),
    "cube-left": ViewKind(_FACE, face=(-90.0, 0.0, 0.0)),
    "cube-up": ViewKind(_FACE, face=(0.0, 90.0, 0.0)),
    "cube-down": ViewKind(_FACE, face=(0.0, -90.0, 0.0)),
}

KEPT = {
    "all": "what is known up to 65 degrees from the view's axis (70 if that takes in all corners)",
    "valid": "the largest picture without black",
}
"""What a fitted view keeps."""

METHODS = {
    "remap": "backward interpolation",
    "splat": "the paper's forward map with a median filter, several times slower",
}
"""How pictures are resampled."""


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """What is asked of a view of a camera; by default the view along its optical axis, fitted to what is known.

    ``name``: ``camera`` looks along the optical axis and ``board`` straight at the reference board, both as pinhole
    cameras; ``cylindrical`` and ``equirectangular`` look along the axis and all around; ``cube-front``, ``-right``,
    ``-back``, ``-left``, ``-up`` and ``-down`` are the faces of a cube, 90° wide and square.

    ``size`` (width, height) px defaults to the image's. ``turn`` rotates the view from there. ``fov`` is its horizontal
    field of view in degrees, centred in the image; without it the view is fitted to the valid pixels: ``keep="all"``
    shows all of them within the limits of :func:`pinholify.rectification.views.fitted_view`, ``keep="valid"`` gives the
    largest view without black pixels (OpenCV's alpha of 1 and 0). ``max_std`` (px) replaces the camera's own limit of
    the standard deviation of what is shown.

    Raises InputError for an unknown name and for options that contradict each other.
    """

    name: str = "camera"
    size: tuple[int, int] | None = None
    turn: YawPitchRoll = STRAIGHT_ON
    fov: float | None = None
    keep: str = "all"
    max_std: float | None = None

    def __post_init__(self) -> None:
        if self.name not in VIEWS:
            raise InputError(f"unknown view '{self.name}': choose one of {', '.join(VIEWS)}")
        if self.keep not in KEPT:
            raise InputError(f"unknown value '{self.keep}' of keep: choose one of {', '.join(KEPT)}")
        if self.fov is not None and self.keep != "all":
            raise InputError("a field of view and what to keep cannot both be given; choose one of the two")
        if VIEWS[self.name].face is not None:
            self._check_face()

    def _check_face(self) -> None:
        face = f"the view '{self.name}' is the face of a cube"
        if self.fov is not None or self.keep != "all":
            raise InputError(f"{face}, always 90 degrees wide; give neither a field of view nor what to keep")
        if self.size is not None and self.size[0] != self.size[1]:
            raise InputError(f"{face}, but {self.size[0]}x{self.size[1]} was requested; give a square size")


DEFAULT_VIEW = ViewOptions()
