"""Frames of a video that are worth keeping: sharp ones, of boards that stand differently."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2

from pinholify.board import Board
from pinholify.errors import InputError
from pinholify.io.images import Image, write_image
from pinholify.web.guidance import Posture, choose, posture
from pinholify.web.looking import Look, examine, reduced, write_pages
from pinholify.web.work import Say

WINDOW_SECONDS = 0.5  # of each such stretch the sharpest frame is looked at
TRIED = 4  # frames of a stretch that are compared
MOST_WINDOWS = 240  # of a longer video, stretches are longer
USUAL_RATE = 30.0
COMPARED_SIDE = 640


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A frame worth keeping: what it shows, and the folder with its ``original`` and pictures for pages."""

    look: Look
    folder: Path
    bytes: int


@dataclass(frozen=True, slots=True)
class Done:
    """The share of a video that has been seen."""

    share: float


def is_video(head: bytes) -> bool:
    """Whether a file that starts with ``head`` is a container of video: MP4 or MOV, Matroska or WebM, AVI.

    Nothing else is opened: playlists and scripts that decoders understand name files and addresses of their own.
    """
    return head[4:8] in {b"ftyp", b"moov", b"mdat", b"wide", b"free"} or head[:4] == b"\x1aE\xdf\xa3" or (
        head[:4] == b"RIFF" and head[8:12] == b"AVI "
    )


def frames(
    say: Say,
    path: Path,
    name: str,
    board: Board | None,
    mirrored: bool,
    kept: list[Posture],
    limits: tuple[int, int],
    folder: Path,
) -> int:
    """Say each :class:`Frame` of the video in ``path`` that differs from those ``kept``, and how far it is.

    ``limits`` are the most pixels of a frame and the most frames. Frames are written into ``folder``. Returns how many
    were kept; raises InputError where it is no video, is too large, or shows no board.
    """
    pixels, most = limits
    video = _opened(path, name, pixels)
    kept, count, boards = list(kept), 0, 0
    for index, (share, image) in enumerate(_sharpest(video)):
        look = examine(image, f"{Path(name).stem}-{index:04d}.png", board, mirrored)
        say(Done(share))
        if look.board is None or look.blur_px is None:
            continue
        board, boards = look.board, boards + 1
        if not choose(look.corners, board, look.size, look.blur_px, kept, None).keep:
            continue
        kept.append(posture(look.corners, board, look.size))
        count += 1
        say(_written(image, look, folder / f"{index:04d}"))
        if count == most:
            break
    if not boards:
        raise InputError(f"no checkerboard was found in '{name}'; film the whole board, slowly, in good light")
    return count


def _opened(path: Path, name: str, pixels: int) -> cv2.VideoCapture:
    with open(path, "rb") as file:
        if not is_video(file.read(16)):
            raise InputError(f"'{name}' is no video this app reads; give MP4, MOV, WebM, MKV or AVI")
    video = cv2.VideoCapture(str(path))
    video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # a calibration belongs to the sensor, as with photographs
    width, height = video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if not video.isOpened() or width * height < 1:
        raise InputError(f"'{name}' cannot be read as a video; give MP4, MOV, WebM, MKV or AVI")
    if width * height > pixels:
        found, most = width * height / 1e6, pixels / 1e6
        raise InputError(f"'{name}' has frames of {found:.0f} megapixels where at most {most:.0f} are read")
    return video


def _sharpest(video: cv2.VideoCapture) -> Iterator[tuple[float, Image]]:
    """The sharpest of a few frames of each stretch of ``video``, and the share of it seen by then."""
    rate = video.get(cv2.CAP_PROP_FPS) or USUAL_RATE
    total = max(video.get(cv2.CAP_PROP_FRAME_COUNT), 1.0)
    window = max(WINDOW_SECONDS * rate, total / MOST_WINDOWS, 1.0)
    step = max(1, round(window / TRIED))
    number = 0
    while candidates := _stretch(video, max(1, round(window)), step):
        number += round(window)
        yield min(1.0, number / total), max(candidates, key=_sharpness)


def _stretch(video: cv2.VideoCapture, length: int, step: int) -> list[Image]:
    """Every ``step``-th of the next ``length`` frames; none at the end of the video."""
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


def _written(image: Image, look: Look, folder: Path) -> Frame:
    write_pages(image, folder)
    write_image(folder / "original.png", image)
    return Frame(look, folder, (folder / "original.png").stat().st_size)
