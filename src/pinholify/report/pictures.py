"""Photographs as a report shows them: thumbnails, and a few frames before and after straightening."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from pinholify.arrays import Floats
from pinholify.board import Board
from pinholify.calibration.result import Calibration
from pinholify.camera import VirtualCamera
from pinholify.corners import Corners, not_found
from pinholify.errors import ImageError
from pinholify.evaluation.wrong_corners import wrong_corners
from pinholify.geometry import convex_hull
from pinholify.io.images import Image, read_image
from pinholify.rectification.maps import RectificationMap, rectification_map, remap
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.views import View, named_view

THUMBNAIL, SMALLEST_THUMBNAIL = 480, 160  # px wide
FULL_SIZE_THUMBNAILS = 45  # more thumbnails are made smaller, so that the page stays a few MB
FRAME = 1280  # px wide at most
OVERSAMPLED = 2  # a straightened frame is made larger by up to this factor, then reduced, against aliasing
JPEG_QUALITY, WEBP_QUALITY = 78, 85


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """An encoded picture: its media type, bytes, and size in px."""

    media_type: str
    data: bytes = field(repr=False)
    width: int
    height: int


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One photograph ``before`` and ``after`` straightening.

    ``ruler_before`` and ``ruler_after`` (k, 2 ends, 2) join the end corners of a board's outer rows and columns by
    straight lines, as fractions of each picture's width and height.
    """

    name: str
    before: Picture
    after: Picture
    ruler_before: Floats
    ruler_after: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Thumbnails by image name, frames, and the reason by name of each ``missing`` photograph."""

    thumbnails: Mapping[str, Picture] = field(default_factory=dict)
    frames: tuple[Frame, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)


def read_pictures(
    calibration: Calibration,
    photographs: Mapping[str, Path],
    others: Sequence[Path] = (),
    on_read: Callable[[], object] = lambda: None,
) -> Pictures:
    """Read the ``photographs`` of a calibration's views (by name), and one of ``others`` from the same camera.

    Frames are the reference's photograph and the first without a board: of ``others``, or else of the views. A
    photograph that cannot be read or has the wrong size is listed as missing with the reason; for one of ``others`` an
    ImageError is raised. ``on_read`` is called after each photograph of a view.
    """
    views = [view for view in calibration.corner_set.views if view.name in photographs]
    wrong = wrong_corners(calibration, calibration.corner_set)
    belonging = [view.select(wrong.belonging(view)) for view in views]
    framed = framed_views(belonging, calibration.reference, calibration.findings.dropped_boards)
    width = thumbnail_width(len(views))
    framer = _Framer(calibration.camera, calibration.corner_set.board)
    thumbnails: dict[str, Picture] = {}
    frames: list[Frame] = []
    missing = {view.name: "not given" for view in calibration.corner_set.views if view.name not in photographs}
    for view in views:
        try:
            image = _read(photographs[view.name], calibration.camera.image_size)
        except ImageError as error:
            missing[view.name] = str(error)
            continue
        finally:
            on_read()
        thumbnails[view.name] = as_jpeg(shrunk(image, width))
        frames += [framer.frame(image, chosen) for chosen in framed if chosen.name == view.name]
    frames.sort(key=lambda frame: not len(frame.ruler_before))
    if others:
        scene = framer.frame(_read(others[0], calibration.camera.image_size), not_found(others[0].name, ""))
        frames = [*(frame for frame in frames if len(frame.ruler_before)), scene]
    return Pictures(thumbnails, tuple(frames), missing)


def framed_views(views: Sequence[Corners], reference: str, dropped: Container[str]) -> list[Corners]:
    """The reference (or else the largest board), and the first view without a usable board, its corners removed."""
    boards = [view for view in views if view.found and view.name not in dropped]
    scenes = [not_found(view.name, "") for view in views if not view.found or view.name in dropped]
    return sorted(boards, key=lambda v: (v.name != reference, -convex_hull(v.uv).area))[:1] + scenes[:1]


def thumbnail_width(count: int) -> int:
    """Width in px at which ``count`` thumbnails together stay a few MB."""
    shrink = np.sqrt(FULL_SIZE_THUMBNAILS / max(count, FULL_SIZE_THUMBNAILS))
    return max(SMALLEST_THUMBNAIL, round(THUMBNAIL * float(shrink)))


def _read(path: Path, size: tuple[int, int]) -> Image:
    image = eight_bits(read_image(path))
    height, width = image.shape[:2]
    if (width, height) != size:
        raise ImageError(
            f"'{path}' is {width}x{height} and the camera was calibrated at {size[0]}x{size[1]}: "
            "give the photographs that the camera was made from"
        )
    return image


def eight_bits(image: Image) -> Image:
    """The image with 8 bits per channel."""
    return image if image.dtype == np.uint8 else np.asarray((image >> 8).astype(np.uint8))


def shrunk(image: Image, width: int) -> Image:
    """The image, reduced to at most ``width`` px wide."""
    if image.shape[1] <= width:
        return image
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA))


def as_jpeg(image: Image) -> Picture:
    """The image as JPEG, without the metadata of its file."""
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return Picture("image/jpeg", data.tobytes(), image.shape[1], image.shape[0])


def as_webp(image: Image) -> Picture:
    """The image (with alpha) as WebP."""
    data = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])[1]
    return Picture("image/webp", data.tobytes(), image.shape[1], image.shape[0])


class _Framer:
    """Makes the frames of one camera; the map is built for the first and kept."""

    def __init__(self, camera: VirtualCamera, board: Board) -> None:
        self.camera, self.board = camera, board
        self._map: RectificationMap | None = None

    def _rectification(self) -> RectificationMap:
        if self._map is None:
            width, height = self.camera.image_size
            scale = min(1.0, OVERSAMPLED * FRAME / width)
            size = (round(width * scale), round(height * scale))
            self._map = rectification_map(self.camera, named_view(self.camera, ViewOptions(size=size)))
        return self._map

    def frame(self, image: Image, view: Corners) -> Frame:
        """The frame of ``image``, whose corners are ``view``."""
        rectification = self._rectification()
        straight = remap(image, rectification)
        colour = cv2.cvtColor(straight, cv2.COLOR_GRAY2BGR) if straight.ndim == 2 else straight
        alpha = np.where(rectification.valid, 255, 0).astype(np.uint8)
        after = shrunk(np.dstack([colour, alpha]), FRAME)
        ends = ruler_ends(view, self.board)
        return Frame(
            view.name,
            as_jpeg(shrunk(image, FRAME)),
            as_webp(after),
            (ends + 0.5) / self.camera.image_size,
            (_straightened(ends, self.camera, rectification.view) + 0.5) / rectification.view.size,
        )


def ruler_ends(view: Corners, board: Board) -> Floats:
    """End corners (k, 2, 2) px of a view's outermost rows and columns, where at least three corners were found."""
    lattice = view.lattice(board)
    ends = []
    for across, along in ((1, 0), (0, 1)):
        for extreme in np.unique([lattice[:, across].min(initial=0.0), lattice[:, across].max(initial=0.0)]):
            line = np.flatnonzero(lattice[:, across] == extreme)
            if len(line) >= 3:
                place = lattice[line, along]
                ends.append(view.uv[[line[place.argmin()], line[place.argmax()]]])
    return np.array(ends).reshape(-1, 2, 2)


def _straightened(ends: Floats, camera: VirtualCamera, view: View) -> Floats:
    if not len(ends):
        return ends
    return view.project(camera.to_rays(ends.reshape(-1, 2)).directions).reshape(-1, 2, 2)
