"""Where corners come from: photographs, or a corner table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from pinholify.board import Board
from pinholify.cli.options import progress, say
from pinholify.corners import CornerSet


def detect_with_progress(
    images: Sequence[Path], board: Board, mirrored: bool, workers: int | None = None
) -> CornerSet:
    """The corners of ``board`` in files and folders of images."""
    from pinholify.detection import detect_files
    from pinholify.io.images import image_paths

    paths = image_paths(images)
    with progress("Looking for boards", len(paths)) as advance:
        return detect_files(paths, board, mirrored=mirrored, workers=workers, on_result=lambda _: advance())


def gather_corners(
    images: Sequence[Path],
    table: str | None,
    board: Board,
    image_size: tuple[int, int] | None,
    mirrored: bool,
) -> CornerSet:
    """Corners from photographs or from a table (``-`` is standard input), whichever was given."""
    import sys

    from pinholify.io.corner_tables import read_corner_table

    if bool(images) == (table is not None):
        raise click.UsageError("give either IMAGES or --corners FILE")
    if table is None:
        if image_size is not None:
            raise click.UsageError("--image-size goes with --corners; photographs tell their own size")
        return detect_with_progress(images, board, mirrored)
    if image_size is None:
        raise click.UsageError("--corners needs --image-size WxH: a table does not tell the size of the images")
    return read_corner_table(sys.stdin if table == "-" else table, board=board, image_size=image_size)


def report_missing(corners: CornerSet) -> None:
    """Say which images show no board, and why."""
    for view in corners.views:
        if not view.found:
            say(f"{view.name}: {view.reason or 'no board found'}")


def is_corner_table(path: Path) -> bool:
    """Whether the file looks like a corner table."""
    with open(path, "rb") as file:
        return file.read(64).lstrip().startswith((b"# filename", b"## "))
