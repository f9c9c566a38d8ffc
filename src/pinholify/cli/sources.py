"""Corners from photographs or videos, or from a corner table."""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli.options import Auto, progress, say
from pinholify.cli.stills import stills_for_videos
from pinholify.errors import CalibrationError, CornerTableError, PinholifyError

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.board import Board
    from pinholify.camera import VirtualCamera
    from pinholify.corners import CornerSet

NAMES_SHOWN = 4
REASONS_SHOWN = 8


def input_files(images: Sequence[Path], table: str | None) -> list[Path]:
    """The files to read: the images, with folders expanded, or the table; UsageError unless exactly one is given."""
    from pinholify.io.images import image_paths

    if bool(images) == (table is not None):
        raise click.UsageError("give either IMAGES or --corners FILE")
    return image_paths(images) if table is None else [Path(table)]


def size_of_first(images: Sequence[Path]) -> tuple[int, int] | None:
    """Width and height in px of the first of the image files; None for a video, and where it cannot be read."""
    from pinholify.io.images import image_paths, read_image

    try:
        height, width = read_image(image_paths(images)[0]).shape[:2]
    except (IndexError, PinholifyError):
        return None
    return width, height


def detect_with_progress(
    images: Sequence[Path],
    board: Board | Auto,
    mirrored: bool,
    *,
    camera: VirtualCamera | None = None,
    workers: int | None = None,
    needed: int = 1,
) -> CornerSet:
    """Detect ``board`` in image files and frames of videos; with a ``camera``, look a second time.

    Reports the images without a board, and raises CalibrationError if fewer than ``needed`` show one.
    """
    from pinholify.detection import detect_files

    with stills_for_videos(images) as files:
        known = _agreed_board(files, workers) if isinstance(board, str) else board
        with progress("Looking for boards", len(files)) as advance:
            corners = detect_files(files, known, mirrored=mirrored, workers=workers, on_result=lambda _: advance())
        if camera is not None:
            corners = _again(files, corners, camera, workers)
    check_found(corners, needed)
    return corners


def look_again_with_progress(images: Sequence[Path], corners: CornerSet, camera: VirtualCamera) -> CornerSet:
    """Look a second time at ``images``, in which ``corners`` were found, now that their ``camera`` is known."""
    with stills_for_videos(images) as files:
        return _again(files, corners, camera, None)


def _again(files: Sequence[Path], corners: CornerSet, camera: VirtualCamera, workers: int | None) -> CornerSet:
    from pinholify.detection import look_again_in_files

    with progress("Looking again", len(files)) as advance:
        more = look_again_in_files(files, corners, camera, workers=workers, on_result=lambda _: advance())
    before, after = (sum(map(len, found.views)) for found in (corners, more))
    say(f"a second look, with the camera known: {after} corners instead of {before}")
    return more


def _agreed_board(files: Sequence[Path], workers: int | None) -> Board:
    """The checkerboard that most of ``files`` show whole; prints its size."""
    from pinholify.detection import detect_size_in_files

    with progress("Looking for the board's size", len(files)) as advance:
        board, count = detect_size_in_files(files, workers=workers, on_result=lambda _: advance())
    say(f"the board has {board.spec} inner corners: it is seen whole in {count} of {len(files)} images")
    return board


def gather_corners(
    images: Sequence[Path],
    table: str | None,
    board: Board | Auto,
    image_size: tuple[int, int] | None,
    mirrored: bool,
    *,
    needed: int = 1,
) -> CornerSet:
    """Corners from photographs or from a table (``-`` is standard input), whichever is given.

    Reports the images without a board, and raises CalibrationError if fewer than ``needed`` show one.
    """
    from pinholify.io.correspondence_tables import read_corners

    files = input_files(images, table)
    if table is None:
        if image_size is not None:
            raise click.UsageError("--image-size goes with --corners; the size of photographs is read from their files")
        return detect_with_progress(files, board, mirrored, needed=needed)
    if image_size is None:
        raise click.UsageError("--corners needs --image-size WxH: a corner table does not contain the image size")
    if isinstance(board, str):
        raise click.UsageError("--board auto goes with photographs; with a corner table give the board, e.g. 9x6")
    corners = read_corners(sys.stdin if table == "-" else table, board=board, image_size=image_size)
    check_plausible(corners)
    check_found(corners, needed)
    return corners


def check_plausible(corners: CornerSet) -> None:
    """Raise CornerTableError if corners lie outside the given image size, or all corners of a view on one line."""
    import numpy as np

    if corners.outside:
        raise CornerTableError(f"{corners.outside}: give the size of the photographs with --image-size")
    for view in corners.found:
        if len(view) > 2 and np.linalg.matrix_rank(view.uv - view.uv.mean(axis=0)) < 2:
            raise CornerTableError(f"all {len(view)} corners of '{view.name}' lie on one line; check the corner table")


def check_found(corners: CornerSet, needed: int) -> None:
    """Report, in few lines, which images show no board and why.

    Raises CalibrationError if there are such images and fewer than ``needed`` show a board.
    """
    reasons: dict[str, list[str]] = defaultdict(list)
    for view in corners.views:
        if not view.found:
            reasons[view.reason or "no board found"].append(view.name)
    ordered = sorted(reasons.items(), key=lambda item: -len(item[1]))
    if reasons and len(corners.found) < needed:
        raise CalibrationError(_too_few(corners, needed, *ordered[0]))
    for reason, names in ordered[:REASONS_SHOWN]:
        say(f"{listed(names)}: {reason}")
    more = sum(len(names) for _, names in ordered[REASONS_SHOWN:])
    if more:
        say(f"{more} more images show no board; 'pinholify detect --json' gives the reason for each")


def _too_few(corners: CornerSet, needed: int, reason: str, names: list[str]) -> str:
    """The sentence on missing boards, with the most frequent ``reason`` and the images ``names`` that it applies to."""
    spec, total, found = corners.board.spec, len(corners.views), len(corners.found)
    if total == 1:
        what = f"no {spec} board was found in '{names[0]}'"
    elif not found:
        what = f"no {spec} board was found in any of the {total} images"
    else:
        what = f"a {spec} board was found in {found} of the {total} images where {needed} are needed"
    count = "" if len(names) == total else f"{listed(names)}: "
    return (
        f"{what} ({count}{reason}); check the board's size ({corners.board.counted}), and that it is sharp "
        "and well lit"
    )


def listed(names: list[str]) -> str:
    """``names`` with commas; a long list is cut."""
    more = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")


def is_corner_table(path: Path) -> bool:
    """Whether the file looks like a corner table."""
    with open(path, "rb") as file:
        return file.read(64).lstrip().startswith((b"# filename", b"## "))
