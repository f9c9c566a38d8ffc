"""Files to download: exports, reports, corner tables, boards to print."""

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


@dataclass(frozen=True, slots=True)
class Download:
    """A file to download, and ``notes`` on what its format cannot represent."""

    path: Path
    notes: tuple[str, ...] = ()


def export(folder: Path, camera: Path, format_name: str) -> Download:
    """The camera in another program's format, in ``folder``: one file, or an archive if the format has several."""
    form = format_named(format_name)
    path = make_folder(folder) / f"{format_name}{form.suffixes[0]}"
    notes = tuple(export_view(read_camera(camera).camera, format_name, path))
    files = [file for file in folder.iterdir() if file.is_file()]
    if len(files) == 1:
        return Download(files[0], notes)
    archive = folder / f"{format_name}.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as pack:
        for file in sorted(files):
            pack.write(file, file.name)
    return Download(archive, notes)


def report(path: Path, camera: Path, photographs: dict[str, Path]) -> None:
    """Write the report of the ``camera`` file with its ``photographs`` by name to ``path``."""
    calibration = read_camera(camera)
    evaluation, verdict = evaluated(calibration)
    pictures = read_pictures(calibration, photographs)
    write_report(path, make_report(evaluation, verdict, provenance_of(camera), pictures))


def corner_table(folder: Path, corners: CornerSet) -> Download:
    """The corners as a table in ``folder``."""
    path = make_folder(folder) / "corners.vnl"
    write_corner_table(path, corners)
    return Download(path)


def board_sheet(folder: Path, board: Board, square_mm: float, page: str, ending: str) -> Download:
    """A board to print, in ``folder``, in the format of the file extension ``ending``."""
    path = make_folder(folder) / f"board{ending}"
    write_board(board, path, square_mm=square_mm, page=page)
    return Download(path)
