"""The command ``pinholify simulate``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli.options import examples, overwrite_option, progress
from pinholify.errors import OutputError

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.simulation.datasets import Dataset


@click.command("simulate", epilog=examples("pinholify simulate unity-barrel -o data/"))
@click.argument("name")
@click.option("-o", "folder", type=click.Path(path_type=Path), required=True, help="Folder to write into.")
@click.option("--views", type=click.IntRange(1), help="Number of photographs to render, at most those of the data set.")
@overwrite_option
def command(name: str, folder: Path, views: int | None, force: bool) -> None:
    """Render NAME, one of the paper's six data sets (or all): photographs, true corners, true camera.

    The data sets: unity-pinhole, unity-barrel, unity-pincushion, webcam, webcam-telelens and mirror.

    Writes NAME/*.png, NAME/corners.vnl and NAME/truth.npz (rays of a grid of pixels, f, uc, vc). Cameras that send JPEG
    are written as PNG too: their pixels already have its artefacts, which must not be applied twice.
    """
    from pinholify.simulation.datasets import DATASETS

    if name != "all" and name not in DATASETS:
        raise click.UsageError(f"unknown data set '{name}': choose one of all, {', '.join(DATASETS)}")
    chosen = list(DATASETS.values()) if name == "all" else [DATASETS[name]]
    taken = [d.name for d in chosen if (folder / d.name).exists()]
    if taken and not force:
        raise OutputError(f"'{folder / taken[0]}' is already there; choose another folder, or use --force")
    for dataset in chosen:
        count = min(views or dataset.views, dataset.views)
        with progress(dataset.title, count) as advance:
            write_dataset(dataset, folder / dataset.name, count, advance)
        click.echo(f"wrote {count} photographs of {dataset.title} into {folder / dataset.name}")


def write_dataset(dataset: Dataset, folder: Path, count: int, advance: Callable[[], None]) -> None:
    """Render ``count`` photographs of ``dataset`` into ``folder``, with corners and truth; ``advance`` counts them."""
    import numpy as np

    from pinholify.corners import Corners, CornerSet
    from pinholify.io.corner_tables import write_corner_table
    from pinholify.io.files import atomic_path, make_folder
    from pinholify.io.images import write_image

    make_folder(folder)
    views = []
    for picture in dataset.photographs(count):
        name = f"{picture.name}.png"
        write_image(folder / name, picture.image)
        views.append(Corners(name, np.arange(len(picture.corners)), picture.corners))
        advance()
    write_corner_table(folder / "corners.vnl", CornerSet(dataset.board, dataset.lens.size, tuple(views)))
    truth = dataset.truth()
    with atomic_path(folder / "truth.npz") as temporary, open(temporary, "wb") as file:
        np.savez_compressed(
            file,
            size=truth.size,
            pixels=truth.pixels,
            origins=truth.origins,
            directions=truth.directions,
            central=truth.central,
            mirrored=truth.mirrored,
            f_uc_vc=truth.virtual_camera or (np.nan,) * 3,
        )
