"""Looking at one picture: its corners, how sharp it is, and the pictures of it that pages show."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.board import Board
from pinholify.corners import Corners, not_found
from pinholify.detection import detect_board, detect_size
from pinholify.io.images import Image, decode_image, read_bytes, write_image
from pinholify.report.pictures import eight_bits
from pinholify.web.work import Say

VIEW_SIDE, THUMB_SIDE = 1600, 480
SLOPE_PERCENTILE = 99.0

NO_SIZE = "no whole checkerboard was found; give the board's size, or a photograph that shows all of it"


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What one picture shows; ``board`` is the one looked for, or the one it showed where none was given.

    ``blur_px`` is the standard deviation of the blur on the board, ``suggestion`` the size of another whole board.
    """

    corners: Corners
    size: tuple[int, int]
    board: Board | None
    blur_px: float | None
    suggestion: str | None


def look(say: Say, path: Path, name: str, board: Board | None, mirrored: bool, pixels: int, pages: Path | None) -> Look:
    """Find the corners of ``board``, or of whatever whole checkerboard there is, in the picture in ``path``.

    Pictures for pages are written into the folder ``pages``. Raises ImageError, which calls the picture ``name``, where
    it is none or has more than ``pixels`` pixels.
    """
    image = decode_image(read_bytes(path), name, max_pixels=pixels)
    seen = examine(image, name, board, mirrored)
    if pages is not None:
        write_pages(image, pages)
    return seen


def show(say: Say, path: Path, name: str, pixels: int, pages: Path) -> None:
    """Write the pictures for pages of the picture in ``path`` into the folder ``pages``."""
    write_pages(decode_image(read_bytes(path), name, max_pixels=pixels), pages)


def examine(image: Image, name: str, board: Board | None, mirrored: bool) -> Look:
    """What ``image`` shows."""
    size = (image.shape[1], image.shape[0])
    wanted = board or detect_size(image)
    if wanted is None:
        return Look(not_found(name, NO_SIZE), size, None, None, None)
    corners = detect_board(image, wanted, name=name, mirrored=mirrored)
    if corners.found:
        return Look(corners, size, wanted, blur(image, corners), None)
    other = detect_size(image)
    suggestion = other.spec if other is not None and other != wanted else None
    return Look(corners, size, wanted, None, suggestion)


def blur(image: Image, corners: Corners) -> float:
    """Standard deviation in px of the blur of the board's edges: their steepest slope against their contrast."""
    low, high = corners.uv.min(axis=0), corners.uv.max(axis=0)
    (left, top), (right, bottom) = np.maximum(low, 0).astype(int), np.ceil(high).astype(int) + 1
    patch = image[top:bottom, left:right]
    grey = cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY) if patch.ndim == 3 else patch
    grey = grey.astype(np.float32)
    slope = np.hypot(cv2.Scharr(grey, cv2.CV_32F, 1, 0), cv2.Scharr(grey, cv2.CV_32F, 0, 1)) / 32.0
    dark, light = np.percentile(grey, [5, 95])
    steepest = float(np.percentile(slope, SLOPE_PERCENTILE))
    return float((light - dark) / (max(steepest, 1e-6) * np.sqrt(2 * np.pi)))


def write_pages(image: Image, folder: Path) -> None:
    """``view.jpg`` and ``thumb.jpg`` of ``image`` in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    view = reduced(eight_bits(image), VIEW_SIDE)
    write_image(folder / "view.jpg", view)
    write_image(folder / "thumb.jpg", reduced(view, THUMB_SIDE))


def reduced(image: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """``image`` with its longer side at most ``side`` px."""
    height, width = image.shape[:2]
    scale = side / max(width, height)
    if scale >= 1:
        return image
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
