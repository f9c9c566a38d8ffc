"""The pinhole view that is exported, and the interface of an export format."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Floats
from pinholify.camera import VirtualCamera
from pinholify.errors import InputError, OutputError
from pinholify.io.export import format_named
from pinholify.rectification.maps import RectificationMap, rectification_map
from pinholify.rectification.straightener import Straightener
from pinholify.rectification.surfaces import Plane
from pinholify.rectification.views import STRAIGHT_ON, View, YawPitchRoll, share_outside

OUTSIDE = -1.0
"""px; the value in other programs' maps for pixels of the view that show nothing that can be trusted."""


@dataclass(frozen=True, slots=True, eq=False)
class PinholeExport:
    """An ideal pinhole view of a camera, and the maps that make its images.

    ``view_name``, ``turn``, ``fov``, ``keep`` and ``max_std`` are the options with which ``pinholify undistort`` makes
    the same images.
    """

    camera: VirtualCamera
    view_name: str
    max_std: float | None
    rectification: RectificationMap
    turn: YawPitchRoll = STRAIGHT_ON
    fov: float | None = None
    keep: str = "all"

    @property
    def view(self) -> View:
        """The ideal pinhole camera."""
        return self.rectification.view

    @property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy of the view in px, (0, 0) at the centre of the top-left pixel."""
        k = self.view.matrix
        return float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])

    @property
    def maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Columns and rows, each (h, w) float32, of the original image for every pixel of the view; −1 if not valid."""
        uv = np.where(self.rectification.valid[:, :, None], self.rectification.uv, np.float32(OUTSIDE))
        return np.ascontiguousarray(uv[:, :, 0]), np.ascontiguousarray(uv[:, :, 1])

    @property
    def statement(self) -> tuple[str, ...]:
        """Lines for a comment, plain ASCII without apostrophes, on which view this is and how to make its images."""
        return (
            f'The ideal pinhole view "{self.view_name}" of a camera calibrated by pinholify: no distortion.',
            "It describes straightened images, not those that the camera takes; make them with: pinholify undistort "
            f"CAMERA IMAGES {self.options} -o FOLDER",
            f"Rotation to the view from the frame of the reference board, row by row: {numbers(self.view.rotation)}",
        )

    @property
    def options(self) -> str:
        """The view as options of ``pinholify undistort``."""
        width, height = self.view.size
        words = [f"--view {self.view_name} --size {width}x{height}"]
        if self.turn != STRAIGHT_ON:
            words.append("--turn " + ",".join(np.format_float_positional(angle, trim="-") for angle in self.turn))
        if self.fov is not None:
            words.append(f"--fov {self.fov!r}")
        if self.keep != "all":
            words.append(f"--keep {self.keep}")
        if self.max_std is not None:
            words.append(f"--max-std {self.max_std!r}")
        return " ".join(words)

    def losses(self) -> list[str]:
        """Sentences on what the view leaves out; empty if it shows everything that can be trusted."""
        empty = 1.0 - float(self.rectification.valid.mean())
        unseen = share_outside(self.camera, self.view, self.max_std)
        sentences = []
        if empty >= 0.0005:
            black = "shows nothing that can be trusted and is black in its images"
            sentences.append(f"{100 * empty:.1f} % of the view {black}")
        if unseen >= 0.0005:
            sentences.append(f"{100 * unseen:.1f} % of the trusted part of the original image lies outside the view")
        return sentences


def pinhole_export(
    camera: VirtualCamera,
    view_name: str = "camera",
    *,
    size: tuple[int, int] | None = None,
    max_std: float | None = None,
    turn: YawPitchRoll = STRAIGHT_ON,
    fov: float | None = None,
    keep: str = "all",
) -> PinholeExport:
    """The flat view of ``camera`` called ``view_name``, ready for any format.

    Options are those of :class:`pinholify.rectification.straightener.Straightener`. Raises InputError for a view that
    is unknown or not flat, or a size that is too large, and CalibrationError for a view that shows nothing.
    """
    view = Straightener(camera, view_name, size, max_std=max_std, turn=turn, fov=fov, keep=keep).view
    if not isinstance(view.surface, Plane):
        raise InputError(f"the view '{view_name}' is not a pinhole camera and cannot be exported; choose a flat view")
    rectification = rectification_map(camera, view, max_std=max_std)
    return PinholeExport(camera, view_name, max_std, rectification, turn, fov, keep)


@dataclass(frozen=True, slots=True)
class Format:
    """One export format.

    ``write`` writes an export to the path given by the user, and may return sentences on what it found; ``files`` lists
    the files it will write for that path. ``suffixes`` are the endings that the path may have, the usual one first.
    ``lost`` is a sentence on what the format cannot represent, or empty. If ``of_view`` is false, the format describes
    the camera itself, and the view only determines its frame.
    """

    suffixes: tuple[str, ...]
    write: Callable[[PinholeExport, Path], list[str] | None]
    lost: str = ""
    files: Callable[[Path], tuple[Path, ...]] = lambda path: (path,)
    of_view: bool = True

    def check_path(self, path: Path) -> None:
        """Raise OutputError if the ending of ``path`` is not one of the format's."""
        if path.suffix.lower() not in self.suffixes:
            raise OutputError(
                f"'{path}' ends in '{path.suffix}', but files of this format end in {' or '.join(self.suffixes)}; "
                "choose such a name"
            )


def export_view(
    camera: VirtualCamera,
    format_name: str,
    path: str | os.PathLike[str],
    view_name: str = "camera",
    *,
    size: tuple[int, int] | None = None,
    max_std: float | None = None,
    turn: YawPitchRoll = STRAIGHT_ON,
    fov: float | None = None,
    keep: str = "all",
) -> list[str]:
    """Write the view of ``camera`` called ``view_name`` to ``path`` in the format called ``format_name``.

    Options are those of :func:`pinhole_export`. Existing files are replaced. Returns one sentence for each thing that
    the view or the format leaves out. Raises InputError, CalibrationError, or OutputError if a file cannot be written.
    """
    form = format_named(format_name)
    form.check_path(Path(path))
    if not form.of_view and not (size is None and fov is None and keep == "all"):
        raise InputError(
            f"'{format_name}' describes the camera's own images as a whole; omit size, fov and keep"
        )
    export = pinhole_export(camera, view_name, size=size, max_std=max_std, turn=turn, fov=fov, keep=keep)
    found = form.write(export, Path(path)) or []
    return [*found, *(export.losses() if form.of_view else []), *([form.lost] if form.lost else [])]


NO_MAPS = "the format cannot hold the maps: it describes images that 'pinholify undistort' made of this view"
"""What formats that only hold K lose."""


def sibling(path: Path, ending: str) -> Path:
    """``path`` with ``ending`` inserted before its suffix."""
    return path.with_name(f"{path.stem}{ending}{path.suffix}")


def numbers(values: Floats) -> str:
    """All ``values`` in full precision, separated by commas."""
    return ", ".join(repr(float(v)) for v in np.ravel(values))


def commented(lines: tuple[str, ...]) -> str:
    """``lines`` as comments of YAML and plain text files, which begin with #."""
    return "".join(f"# {line}\n" for line in lines)
