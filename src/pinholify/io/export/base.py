"""What is exported, and what a format is."""

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
from pinholify.rectification.views import View, believable, image_samples

OUTSIDE = -1.0
"""px; where maps for other programs point when a pixel of the view shows nothing that may be believed."""


@dataclass(frozen=True, slots=True, eq=False)
class PinholeExport:
    """An ideal pinhole view of a camera and the maps that make its images.

    ``view_name`` and ``max_std`` are what ``pinholify undistort`` must be told to make the same images.
    """

    camera: VirtualCamera
    view_name: str
    max_std: float | None
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
        """Columns and rows of the original image for every pixel of the view (h, w) float32, −1 where not valid."""
        uv = np.where(self.rectification.valid[:, :, None], self.rectification.uv, np.float32(OUTSIDE))
        return np.ascontiguousarray(uv[:, :, 0]), np.ascontiguousarray(uv[:, :, 1])

    @property
    def statement(self) -> tuple[str, ...]:
        """Which view this is and how its images are made: plain ASCII lines, without apostrophes, for a comment."""
        width, height = self.view.size
        limit = "" if self.max_std is None else f" --max-std {self.max_std!r}"
        return (
            f'The ideal pinhole view "{self.view_name}" of a camera calibrated by pinholify: no distortion.',
            "It is true of straightened images, not of those the camera takes; make them with: pinholify undistort "
            f"CAMERA IMAGES --view {self.view_name} --size {width}x{height}{limit} -o FOLDER",
            f"Rotation to the view from the frame of the reference board, row by row: {numbers(self.view.rotation)}",
        )

    def losses(self) -> list[str]:
        """Sentences about what the view leaves out; empty where it shows all that may be believed."""
        empty, unseen = 1.0 - float(self.rectification.valid.mean()), self._unseen()
        sentences = []
        if empty >= 0.0005:
            sentences.append(f"{empty:.1%} of the view shows nothing that may be believed and is black in its images")
        if unseen >= 0.0005:
            sentences.append(f"{unseen:.1%} of what may be believed of the original image lies outside the view")
        return sentences

    def _unseen(self) -> float:
        """Share of the believable part of the original image that the view does not show."""
        pixels = image_samples(self.camera.image_size)
        pixels = pixels[believable(self.camera, pixels, self.max_std)]
        seen = self.view.project(self.camera.chart.directions(self.camera.plane_map.value(pixels)))
        # The view's border runs through its outermost pixels' outer edges.
        shown = ((seen >= -0.5) & (seen <= np.array(self.view.size) - 0.5)).all(axis=1)
        return 1.0 - float(shown.mean())


def pinhole_export(
    camera: VirtualCamera,
    view_name: str = "camera",
    *,
    size: tuple[int, int] | None = None,
    max_std: float | None = None,
) -> PinholeExport:
    """The view of ``camera`` called ``view_name`` (``camera`` or ``board``), ready for any format.

    ``size`` (width, height) px defaults to the image's; ``max_std`` px replaces the camera's domain as the limit of
    what is shown. Raises InputError for an unknown view or too large a size, CalibrationError for a view that shows
    nothing.
    """
    view = Straightener(camera, view_name, size, max_std=max_std).view
    if not isinstance(view.surface, Plane):
        raise InputError(f"the view '{view_name}' is no pinhole camera, which is what is exported; choose a flat view")
    return PinholeExport(camera, view_name, max_std, rectification_map(camera, view, max_std=max_std))


@dataclass(frozen=True, slots=True)
class Format:
    """One export format.

    ``write`` makes the files from an export and the path the user gave, and may return sentences about what it found;
    ``files`` tells beforehand which files they are. ``suffixes`` are the endings that path may have, the usual one
    first. ``lost`` says what of the export the format cannot hold, or is empty. Where ``of_view`` is false the format
    holds the camera itself, and of the view only its frame.
    """

    suffixes: tuple[str, ...]
    write: Callable[[PinholeExport, Path], list[str] | None]
    lost: str = ""
    files: Callable[[Path], tuple[Path, ...]] = lambda path: (path,)
    of_view: bool = True

    def check_path(self, path: Path) -> None:
        """Raise OutputError where ``path`` has an ending by which nobody would know the format."""
        if path.suffix.lower() not in self.suffixes:
            raise OutputError(
                f"'{path}' ends in '{path.suffix}' where this format ends in {' or '.join(self.suffixes)}; "
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
) -> list[str]:
    """Write the view of ``camera`` called ``view_name`` to ``path`` in the format called ``format_name``.

    Options are those of :func:`pinhole_export`. Files that are there are replaced. Returns a sentence for everything
    that the view or the format leaves out. Raises InputError, CalibrationError, or OutputError where a file cannot be
    written.
    """
    form = format_named(format_name)
    form.check_path(Path(path))
    if size is not None and not form.of_view:
        raise InputError(f"'{format_name}' is of the camera's own images, whose size is given; leave the size out")
    export = pinhole_export(camera, view_name, size=size, max_std=max_std)
    found = form.write(export, Path(path)) or []
    return [*found, *(export.losses() if form.of_view else []), *([form.lost] if form.lost else [])]


NO_MAPS = "the format has no room for the maps: it is true of images that 'pinholify undistort' made of this view"
"""What formats for K alone lose."""


def beside(path: Path, ending: str) -> Path:
    """``path`` with ``ending`` put before its suffix."""
    return path.with_name(f"{path.stem}{ending}{path.suffix}")


def numbers(values: Floats) -> str:
    """All ``values``, in full precision, separated by commas."""
    return ", ".join(repr(float(v)) for v in np.ravel(values))


def commented(lines: tuple[str, ...]) -> str:
    """``lines`` behind the # of YAML and plain text files."""
    return "".join(f"# {line}\n" for line in lines)
