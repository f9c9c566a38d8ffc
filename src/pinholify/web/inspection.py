"""Inspecting a picture: its corners, its blur, and the reduced copies of it that pages show."""

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

VIEW_SIDE, THUMB_SIDE = 1600, 480
SLOPE_PERCENTILE = 99.0

NO_SIZE = "no whole checkerboard was found; enter the board's size, or add a photograph that shows all of it"


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """The result of inspecting a picture.

    ``size`` is (width, height) in px. ``board`` is the board that was searched for, or the one that was found if none
    was given. ``blur_px`` is the standard deviation of the blur on the board, ``suggestion`` the size of another whole
    board.
    """

    corners: Corners
    size: tuple[int, int]
    board: Board | None
    blur_px: float | None
    suggestion: str | None


def inspect_file(
    path: Path, name: str, board: Board | None, mirrored: bool, pixels: int, previews: Path | None
) -> Inspection:
    """Find the corners of ``board``, or of any whole checkerboard if that is None, in the picture ``path``.

    Previews are written into the folder ``previews`` if given. Raises ImageError, which calls the picture ``name``, if
    it cannot be read or has more than ``pixels`` pixels.
    """
    image = decode_image(read_bytes(path), name, max_pixels=pixels)
    inspection = inspect_image(image, name, board, mirrored)
    if previews is not None:
        write_previews(image, previews)
    return inspection


def write_file_previews(path: Path, name: str, pixels: int, previews: Path) -> None:
    """Write previews of the picture ``path`` into the folder ``previews``; raises as :func:`inspect_file`."""
    write_previews(decode_image(read_bytes(path), name, max_pixels=pixels), previews)


def inspect_image(image: Image, name: str, board: Board | None, mirrored: bool) -> Inspection:
    """Find the corners of ``board``, or of any whole checkerboard if that is None, in ``image``."""
    size = (image.shape[1], image.shape[0])
    board = board or detect_size(image)
    if board is None:
        return Inspection(not_found(name, NO_SIZE), size, None, None, None)
    corners = detect_board(image, board, name=name, mirrored=mirrored)
    if corners.found:
        return Inspection(corners, size, board, blur(image, corners), None)
    other = detect_size(image)
    suggestion = other.spec if other is not None and other != board else None
    return Inspection(corners, size, board, None, suggestion)


def blur(image: Image, corners: Corners) -> float:
    """Standard deviation in px of the blur of the board's edges, from their contrast and steepest slope."""
    low, high = corners.uv.min(axis=0), corners.uv.max(axis=0)
    (left, top), (right, bottom) = np.maximum(low, 0).astype(int), np.ceil(high).astype(int) + 1
    patch = image[top:bottom, left:right]
    grey = cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY) if patch.ndim == 3 else patch
    grey = grey.astype(np.float32)
    slope = np.hypot(cv2.Scharr(grey, cv2.CV_32F, 1, 0), cv2.Scharr(grey, cv2.CV_32F, 0, 1)) / 32.0
    dark, light = np.percentile(grey, [5, 95])
    steepest = float(np.percentile(slope, SLOPE_PERCENTILE))
    return float((light - dark) / (max(steepest, 1e-6) * np.sqrt(2 * np.pi)))


def write_previews(image: Image, folder: Path) -> None:
    """Write ``view.jpg`` and ``thumb.jpg``, reduced copies of ``image``, into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    view = reduced(eight_bits(image), VIEW_SIDE)
    write_image(folder / "view.jpg", view)
    write_image(folder / "thumb.jpg", reduced(view, THUMB_SIDE))


def reduced(image: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """``image`` reduced so that its longer side is at most ``side`` px."""
    height, width = image.shape[:2]
    scale = side / max(width, height)
    if scale >= 1:
        return image
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
