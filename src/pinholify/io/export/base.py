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
from pinholify.rectification.options import DEFAULT_VIEW, STRAIGHT_ON, ViewOptions
from pinholify.rectification.straightener import Straightener
from pinholify.rectification.surfaces import FlatSurface
from pinholify.rectification.views import View, share_outside

OUTSIDE = -1.0
"""px; the value in other programs' maps for pixels of the view that show nothing that can be trusted."""


@dataclass(frozen=True, slots=True, eq=False)
class PinholeExport:
    """An ideal pinhole view of a camera, what was asked of it, and the maps that make its images."""

    camera: VirtualCamera
    options: ViewOptions
    rectification: RectificationMap

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
            f'The ideal pinhole view "{self.options.name}" of a camera calibrated by pinholify: no distortion.',
            "It describes straightened images, not those that the camera takes; make them with: pinholify undistort "
            f"CAMERA IMAGES {self.words} -o FOLDER",
            f"Rotation to the view from the frame of the reference board, row by row: {numbers(self.view.rotation)}",
        )

    @property
    def words(self) -> str:
        """The options of ``pinholify undistort`` that make the same images."""
        (width, height), options = self.view.size, self.options
        words = [f"--view {options.name} --size {width}x{height}"]
        if options.turn != STRAIGHT_ON:
            words.append("--turn " + ",".join(np.format_float_positional(angle, trim="-") for angle in options.turn))
        if options.fov is not None:
            words.append(f"--fov {options.fov!r}")
        if options.keep != "all":
            words.append(f"--keep {options.keep}")
        if options.max_std is not None:
            words.append(f"--max-std {options.max_std!r}")
        return " ".join(words)

    def losses(self) -> list[str]:
        """Sentences on what the view leaves out; empty if it shows everything that can be trusted."""
        empty = 1.0 - float(self.rectification.valid.mean())
        unseen = share_outside(self.camera, self.view, self.options.max_std)
        sentences = []
        if empty >= 0.0005:
            black = "shows nothing that can be trusted and is black in its images"
            sentences.append(f"{100 * empty:.1f} % of the view {black}")
        if unseen >= 0.0005:
            sentences.append(f"{100 * unseen:.1f} % of the trusted part of the original image lies outside the view")
        return sentences


def pinhole_export(camera: VirtualCamera, options: ViewOptions = DEFAULT_VIEW) -> PinholeExport:
    """The flat view of ``camera`` that ``options`` describe, ready for any format.

    Raises InputError for a view that is not flat, or a size that is too large, and CalibrationError for a view that
    shows nothing.
    """
    view = Straightener(camera, options).view
    if not isinstance(view.surface, FlatSurface):
        raise InputError(
            f"the view '{options.name}' is not a pinhole camera and cannot be exported; choose a flat view"
        )
    return PinholeExport(camera, options, rectification_map(camera, view, max_std=options.max_std))


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
    camera: VirtualCamera, format_name: str, path: str | os.PathLike[str], options: ViewOptions = DEFAULT_VIEW
) -> list[str]:
    """Write the view of ``camera`` that ``options`` describe to ``path`` in the format called ``format_name``.

    Existing files are replaced. Returns one sentence for each thing that the view or the format leaves out. Raises
    InputError, CalibrationError, or OutputError if a file cannot be written.
    """
    form = format_named(format_name)
    form.check_path(Path(path))
    if not form.of_view and not (options.size is None and options.fov is None and options.keep == "all"):
        raise InputError(f"'{format_name}' describes the camera's own images as a whole; omit size, fov and keep")
    export = pinhole_export(camera, options)
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
