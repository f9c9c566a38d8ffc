"""The rendered photographs on disk: rendered once, and reused by later runs of the same version."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

from pinholify import __version__
from pinholify.io.files import make_folder, writing_text
from pinholify.io.images import write_image
from pinholify.simulation.datasets import Dataset

RECORD = "rendered.json"


def photograph_files(dataset: Dataset, views: int, folder: Path) -> list[Path]:
    """The paths of the first ``views`` photographs of ``dataset`` under ``folder``; PNG, which is lossless."""
    width, height = dataset.lens.size
    home = folder / f"{dataset.name}-{width}x{height}"
    return [home / f"{dataset.name}-{i:02d}.png" for i in range(views)]


def rendered_before(dataset: Dataset, files: list[Path]) -> bool:
    """Whether an earlier run of this version finished rendering ``files`` from the same recipe."""
    try:
        record = json.loads((files[0].parent / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    same = isinstance(record, dict) and record.get("recipe") == _recipe(dataset)
    return same and all(path.is_file() for path in files)


def render_photographs(dataset: Dataset, files: list[Path], advance: Callable[[], object]) -> None:
    """Render ``files``, each written whole or not at all, then write the record that they are complete.

    ``advance`` is called after each. Raises OutputError if the folder cannot be written.
    """
    home = make_folder(files[0].parent)
    record = home / RECORD
    record.unlink(missing_ok=True)
    for path, picture in zip(files, dataset.photographs(len(files)), strict=True):
        write_image(path, picture.image)
        advance()
    with writing_text(record) as file:
        json.dump({"version": __version__, "recipe": _recipe(dataset), "views": len(files)}, file)


def _recipe(dataset: Dataset) -> str:
    """A digest of the version and of everything that the photographs depend on."""
    return hashlib.sha256(f"{__version__} {dataset!r}".encode()).hexdigest()
