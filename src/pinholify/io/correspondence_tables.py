"""Correspondence tables (``.csv``): where a camera sees the nodes of a screen, which a corner table cannot represent.

A header ``filename,X,Y,u,v,std``, then one line per node: the pose's name, the node's position on the screen in screen
pixels, its position in the image in px, and the standard deviation of the latter per axis in px. Nodes may be in any
order; unseen nodes have no line. Names may be quoted as usual in CSV.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TextIO

import numpy as np

from pinholify.board import Board, Screen
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CornerTableError
from pinholify.io.corner_tables import read_corner_table
from pinholify.io.files import TextFile, reading_text, source_name, writing_text

HEADER = ("filename", "X", "Y", "u", "v", "std")
ON_NODE = 1e-3
"""As a fraction of the spacing: how far a rounded position may lie from its node."""


def write_correspondences(target: TextFile, corners: CornerSet, std_px: float) -> None:
    """Write ``corners`` of a screen to ``target``; ``std_px`` is the standard deviation of a node of weight 1.

    Raises OutputError if the file cannot be written, and ValueError if the board is not a screen.
    """
    if not isinstance(corners.board, Screen):
        raise ValueError(f"the nodes of a screen were expected, not the corners of a {corners.board.spec} board")
    with writing_text(target) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(HEADER)
        for view in corners.found:
            writer.writerows(_rows(view, corners.board, std_px))


def _rows(view: Corners, screen: Screen, std_px: float) -> Iterable[tuple[object, ...]]:
    columns = np.column_stack([screen.screen_pixels(view.ids), view.uv, std_px / view.weights])
    return ((view.name, *row) for row in columns.tolist())


def read_correspondences(source: TextFile, *, board: Board, image_size: tuple[int, int]) -> CornerSet:
    """Read the nodes of the screen ``board`` in the table ``source``, a path or an open text stream; one view per pose.

    A node with the table's median standard deviation has weight 1. Raises CornerTableError, with the line number, for
    anything that violates the format, and if ``board`` is not a screen or not that of the table.
    """
    name = source_name(source)
    if not isinstance(board, Screen):
        raise CornerTableError(
            f"'{name}' holds positions on a screen, but the board is {board.spec}: give the screen as the board, for "
            "example gray:1920x1080"
        )
    rows: dict[str, list[tuple[float, ...]]] = {}
    with reading_text(source, CornerTableError) as stream:
        for number, pose, values in _lines(stream, name):
            rows.setdefault(pose, []).append((number, *values))
    if not rows:
        raise CornerTableError(f"'{name}' holds no correspondences; one line per node is needed: {','.join(HEADER)}")
    tables = {pose: np.array(lines) for pose, lines in rows.items()}
    typical = float(np.median(np.concatenate([table[:, 5] for table in tables.values()])))
    views = tuple(_view(pose, table, board, typical, name) for pose, table in tables.items())
    return CornerSet(board, image_size, views)


def _lines(stream: TextIO, name: str) -> Iterator[tuple[int, str, tuple[float, ...]]]:
    """Line number, pose name and the five numbers of each line."""
    reader = csv.reader(stream)
    header = tuple(field.strip() for field in next(reader, []))
    if header != HEADER:
        raise CornerTableError(f"'{name}', line 1: the columns are not {','.join(HEADER)}; write this header")
    for fields in reader:
        if not fields:
            continue
        try:
            values = tuple(float(field) for field in fields[1:])
        except ValueError:
            values = ()
        if len(values) != len(HEADER) - 1 or not all(map(math.isfinite, values)) or values[4] <= 0:
            raise CornerTableError(
                f"'{name}', line {reader.line_num}: a name, four finite numbers and a standard deviation above 0 are "
                "needed, separated by commas"
            )
        yield reader.line_num, fields[0], values


def _view(pose: str, table: np.ndarray, screen: Screen, typical: float, name: str) -> Corners:
    """The nodes of one pose from its ``table`` (n, 6): line, X, Y, u, v, std."""
    place = (table[:, 1:3] + 0.5) / screen.spacing - 0.5
    column, row = np.rint(place).astype(np.int64).T
    off = np.abs(place - np.rint(place)).max(axis=1) > ON_NODE
    off |= (column < 0) | (column >= screen.columns) | (row < 0) | (row >= screen.rows)
    ids = row * screen.columns + column
    if off.any():
        line, x, y = table[off][0, :3]
        raise CornerTableError(
            f"'{name}', line {line:.0f}: ({x:g}, {y:g}) is not a node of {screen.spec}: give the screen's size and the "
            "spacing that it was decoded with"
        )
    order = np.argsort(ids, kind="stable")
    twice = np.flatnonzero(np.diff(ids[order]) == 0)
    if len(twice):
        line = table[order[twice[0] + 1], 0]
        raise CornerTableError(f"'{name}', line {line:.0f}: '{pose}' has this node twice; keep one line")
    return Corners(pose, ids[order], table[order, 3:5], typical / table[order, 5])


def is_correspondence_table(path: Path) -> bool:
    """Whether the file begins like a correspondence table."""
    with open(path, "rb") as file:
        return file.read(64).removeprefix(b"\xef\xbb\xbf").startswith(",".join(HEADER).encode())


def read_corners(source: TextFile, *, board: Board, image_size: tuple[int, int]) -> CornerSet:
    """Read the corners in ``source``, a correspondence table if it begins like one, otherwise a corner table."""
    if isinstance(source, str | Path) and Path(source).is_file() and is_correspondence_table(Path(source)):
        return read_correspondences(source, board=board, image_size=image_size)
    return read_corner_table(source, board=board, image_size=image_size)
