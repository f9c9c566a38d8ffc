"""The whole reproduction: data sets, tables, figures, page."""

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
"""The folder of the rendered photographs; it marks the output folder of an earlier run."""

QUICK_WIDTH = 1280  # px
QUICK_VIEWS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """All ``results`` in the given order, their ``numbers`` (JSON-serialisable), and the ``page`` with them."""

    results: tuple[Reproduced, ...]
    numbers: dict[str, Any]
    page: Path


def quick_version(dataset: Dataset) -> Dataset:
    """``dataset`` with images at most ``QUICK_WIDTH`` px wide."""
    return reduced(dataset, max(1.0, dataset.lens.size[0] / QUICK_WIDTH))


@contextmanager
def unwatched(_text: str, _parts: int | None) -> Iterator[Callable[[], None]]:
    """A ``Watch`` that shows nothing."""
    yield lambda: None


def reproduce(
    folder: Path,
    *,
    quick: bool = False,
    datasets: Sequence[Dataset] = tuple(DATASETS.values()),
    watch: Watch = unwatched,
    workers: int | None = 1,
) -> Reproduction:
    """Reproduce the paper into ``folder``: photographs, corners, cameras, figures, numbers.json, and the page.

    The page is index.html, with the same contents in report.md. Photographs that an earlier run of this version
    finished are reused. ``workers`` processes detect corners (None: one per CPU). Raises OutputError, before any other
    work, if matplotlib is missing or the folder cannot be written.
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
    """Write the detected corners and both cameras."""
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
