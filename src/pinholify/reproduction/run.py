"""The whole reproduction: all data sets, tables, figures, page."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pinholify.io.camera_file import write_camera
from pinholify.io.corner_tables import write_corner_table
from pinholify.io.files import make_folder, writing_text
from pinholify.reproduction.chain import Reproduced, Watch, reproduce_dataset
from pinholify.reproduction.figures import require_matplotlib, write_images_figure, write_pinhole_figure
from pinholify.reproduction.numbers import all_numbers
from pinholify.reproduction.page import html_page, markdown_page
from pinholify.reproduction.pictures import picture_row
from pinholify.simulation.datasets import DATASETS, Dataset, reduced

PHOTOGRAPHS = "photographs"
"""The folder of the rendered photographs; where it is, an earlier run has been."""

QUICK_WIDTH = 1280  # px
QUICK_VIEWS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """All ``results`` in the order given, their ``numbers`` (JSON-able), and the ``page`` that shows them."""

    results: tuple[Reproduced, ...]
    numbers: dict[str, Any]
    page: Path


def quick_version(dataset: Dataset) -> Dataset:
    """``dataset`` in images at most ``QUICK_WIDTH`` wide."""
    return reduced(dataset, max(1.0, dataset.lens.size[0] / QUICK_WIDTH))


@contextmanager
def unwatched(_text: str, _parts: int | None) -> Iterator[Callable[[], None]]:
    """Nobody looks on."""
    yield lambda: None


def reproduce(
    folder: Path,
    *,
    quick: bool = False,
    datasets: Sequence[Dataset] = tuple(DATASETS.values()),
    watch: Watch = unwatched,
    workers: int | None = 1,
) -> Reproduction:
    """Reproduce the paper into ``folder``: its photographs, corners, cameras, figures, numbers.json, and the page.

    The page is index.html, and report.md for where Markdown is read. Photographs that an earlier run of this version
    finished are taken as they are. Corners are found by ``workers`` processes (None: one a CPU). Raises OutputError
    where matplotlib is missing or the folder cannot be written, before any other work.
    """
    require_matplotlib()
    photographs, figures = make_folder(folder / PHOTOGRAPHS), make_folder(folder / "figures")
    started = time.monotonic()
    chosen = [(quick_version(d), min(d.views, QUICK_VIEWS)) if quick else (d, d.views) for d in datasets]
    results = [reproduce_dataset(d, views, photographs, watch, workers=workers) for d, views in chosen]
    for result in results:
        _write_data(result, folder)
    _write_figures(results, figures, watch)
    numbers = all_numbers(results, quick=quick, seconds=time.monotonic() - started)
    _write_page(results, numbers, folder)
    return Reproduction(tuple(results), numbers, folder / "index.html")


def _write_data(result: Reproduced, folder: Path) -> None:
    """The corners that were found, and both cameras."""
    name = result.dataset.name
    write_corner_table(make_folder(folder / "corners") / f"{name}.vnl", result.corner_set)
    cameras = make_folder(folder / "cameras")
    write_camera(cameras / f"{name}-constant-mean.npz", result.paper.evaluation.calibration)
    write_camera(cameras / f"{name}-default-trend.npz", result.ours.evaluation.calibration)


def _write_figures(results: Sequence[Reproduced], folder: Path, watch: Watch) -> None:
    rows = []
    with watch("Straightening and drawing", len(results) + 2) as advance:
        for result in results:
            rows.append(picture_row(result))
            advance()
        write_images_figure(folder / "data-sets.png", results, rows)
        advance()
        write_pinhole_figure(folder / "pinholeness.png", results)
        advance()


def _write_page(results: Sequence[Reproduced], numbers: dict[str, Any], folder: Path) -> None:
    quick, figures = bool(numbers["quick"]), folder / "figures"
    images, pinholes = figures / "data-sets.png", figures / "pinholeness.png"
    with writing_text(folder / "numbers.json") as file:
        json.dump(numbers, file, indent=2)
    with writing_text(folder / "report.md") as file:
        file.write(
            markdown_page(results, quick=quick, images=f"figures/{images.name}", pinholes=f"figures/{pinholes.name}")
        )
    with writing_text(folder / "index.html") as file:
        file.write(html_page(results, quick=quick, images=images, pinholes=pinholes))
