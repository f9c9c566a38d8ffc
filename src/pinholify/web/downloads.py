"""What is taken away: exports, reports, corner tables, boards to print."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

from pinholify.board import Board
from pinholify.corners import CornerSet
from pinholify.io.board_print import write_board
from pinholify.io.camera_file import read_camera
from pinholify.io.corner_tables import write_corner_table
from pinholify.io.export import format_named
from pinholify.io.export.base import export_view
from pinholify.io.files import make_folder
from pinholify.report.contents import make_report
from pinholify.report.evaluated import evaluated
from pinholify.report.formats import write_report
from pinholify.report.pictures import read_pictures
from pinholify.report.provenance import provenance_of
from pinholify.web.work import Say


@dataclass(frozen=True, slots=True)
class Made:
    """A file to take away, and sentences about what it cannot hold."""

    path: Path
    notes: tuple[str, ...] = ()


def export(say: Say, folder: Path, camera: Path, format_name: str) -> Made:
    """The camera in another program's format, in ``folder``: one file, or an archive where the format has several."""
    form = format_named(format_name)
    path = make_folder(folder) / f"{format_name}{form.suffixes[0]}"
    notes = tuple(export_view(read_camera(camera).camera, format_name, path))
    files = [file for file in folder.iterdir() if file.is_file()]
    if len(files) == 1:
        return Made(files[0], notes)
    archive = folder / f"{format_name}.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as pack:
        for file in sorted(files):
            pack.write(file, file.name)
    return Made(archive, notes)


def report(say: Say, path: Path, camera: Path, photographs: dict[str, Path]) -> None:
    """The report of the ``camera`` file with its ``photographs`` by name, written to ``path``."""
    calibration = read_camera(camera)
    evaluation, verdict = evaluated(calibration)
    pictures = read_pictures(calibration, photographs)
    write_report(path, make_report(evaluation, verdict, provenance_of(camera), pictures))


def corner_table(say: Say, folder: Path, corners: CornerSet) -> Made:
    """The corners as a table."""
    path = make_folder(folder) / "corners.vnl"
    write_corner_table(path, corners)
    return Made(path)


def board_sheet(say: Say, folder: Path, board: Board, square_mm: float, page: str, ending: str) -> Made:
    """A board to print."""
    path = make_folder(folder) / f"board{ending}"
    write_board(board, path, square_mm=square_mm, page=page)
    return Made(path)
