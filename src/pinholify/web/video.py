"""Choosing frames of a video: sharp ones that show the board in different postures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2

from pinholify.board import Board
from pinholify.errors import InputError
from pinholify.io.images import Image, write_image
from pinholify.web.guidance import Posture, choose, posture
from pinholify.web.inspection import Inspection, inspect_image, reduced, write_previews
from pinholify.web.process_pool import Report

WINDOW_SECONDS = 0.5  # the sharpest frame of each window is inspected
TRIED = 4  # frames of a window that are compared
MAX_WINDOWS = 240  # longer videos have longer windows
USUAL_RATE = 30.0
COMPARED_SIDE = 640


@dataclass(frozen=True, slots=True, eq=False)
class VideoFrame:
    """A chosen frame, in a ``folder`` with ``original.png`` and its previews."""

    inspection: Inspection
    folder: Path


@dataclass(frozen=True, slots=True)
class Progress:
    """The ``share`` of a video that has been searched, 0 … 1."""

    share: float


def is_video(head: bytes) -> bool:
    """Whether a file that starts with ``head`` is a video container: MP4 or MOV, Matroska or WebM, AVI.

    Nothing else is opened: playlists and scripts that decoders accept can refer to other files and addresses.
    """
    return head[4:8] in {b"ftyp", b"moov", b"mdat", b"wide", b"free"} or head[:4] == b"\x1aE\xdf\xa3" or (
        head[:4] == b"RIFF" and head[8:12] == b"AVI "
    )


def frames(
    report: Report,
    path: Path,
    name: str,
    board: Board | None,
    mirrored: bool,
    kept: list[Posture],
    limits: tuple[int, int],
    folder: Path,
) -> int:
    """Report each :class:`VideoFrame` of ``path`` whose posture differs from those ``kept``, and the progress.

    ``limits`` are the largest number of pixels of a frame and of frames. Frames are written into ``folder``. Returns
    the number of frames; raises InputError if the file is not a video, is too large, or shows no board.
    """
    pixels, most = limits
    video = _opened(path, name, pixels)
    kept, count, boards = list(kept), 0, 0
    for index, (share, image) in enumerate(_sharpest(video)):
        seen = inspect_image(image, f"{Path(name).stem}-{index:04d}.png", board, mirrored)
        report(Progress(share))
        if seen.board is None or seen.blur_px is None:
            continue
        board, boards = seen.board, boards + 1
        if not choose(seen.corners, board, seen.size, seen.blur_px, kept, None).keep:
            continue
        kept.append(posture(seen.corners, board, seen.size))
        count += 1
        report(_written(image, seen, folder / f"{index:04d}"))
        if count == most:
            break
    if not boards:
        raise InputError(f"no checkerboard was found in '{name}'; film the whole board slowly and in good light")
    return count


def _opened(path: Path, name: str, pixels: int) -> cv2.VideoCapture:
    with open(path, "rb") as file:
        if not is_video(file.read(16)):
            raise InputError(f"'{name}' is not a video that this app reads; use MP4, MOV, WebM, MKV or AVI")
    video = cv2.VideoCapture(str(path))
    video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # a calibration belongs to the sensor, as with photographs
    width, height = video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if not video.isOpened() or width * height < 1:
        raise InputError(f"'{name}' cannot be read as a video; use MP4, MOV, WebM, MKV or AVI")
    if width * height > pixels:
        found, most = width * height / 1e6, pixels / 1e6
        raise InputError(f"'{name}' has frames of {found:.0f} megapixels; at most {most:.0f} are supported")
    return video


def _sharpest(video: cv2.VideoCapture) -> Iterator[tuple[float, Image]]:
    """The sharpest of a few frames of each window of ``video``, preceded by the share of it read so far."""
    rate = video.get(cv2.CAP_PROP_FPS) or USUAL_RATE
    total = max(video.get(cv2.CAP_PROP_FRAME_COUNT), 1.0)
    window = max(WINDOW_SECONDS * rate, total / MAX_WINDOWS, 1.0)
    step = max(1, round(window / TRIED))
    number = 0
    while candidates := _next_window(video, max(1, round(window)), step):
        number += round(window)
        yield min(1.0, number / total), max(candidates, key=_sharpness)


def _next_window(video: cv2.VideoCapture, length: int, step: int) -> list[Image]:
    """Every ``step``-th of the next ``length`` frames; empty at the end of the video."""
    images: list[Image] = []
    for number in range(length):
        if not video.grab():
            break
        if number % step == 0:
            read, image = video.retrieve()
            images += [image] if read else []
    return images


def _sharpness(image: Image) -> float:
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    return float(cv2.Laplacian(reduced(grey, COMPARED_SIDE), cv2.CV_32F).var())


def _written(image: Image, inspection: Inspection, folder: Path) -> VideoFrame:
    write_previews(image, folder)
    write_image(folder / "original.png", image)
    return VideoFrame(inspection, folder)
