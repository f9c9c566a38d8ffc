"""The command ``pinholify map``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli.options import check_output, examples, force_option, say

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.arrays import Floats
    from pinholify.camera import VirtualCamera

COLUMNS = {
    "rays": ("x", "y", "z", "std_px"),
    "virtual": ("x", "y", "std_x", "std_y"),
    "image": ("u", "v", "std_u", "std_v"),
}


@click.command("map", epilog=examples(r"printf 'u,v\n100,200\n' | pinholify map camera.npz --to rays -"))
@click.argument("camera", type=click.Path(path_type=Path))
@click.argument("points")
@click.option("--to", "target", type=click.Choice(list(COLUMNS)), required=True, help="What to map the points to.")
@click.option("-o", "output", default="-", show_default=True, help="CSV to write; - is standard output.")
@force_option
def command(camera: Path, points: str, target: str, output: str, force: bool) -> None:
    """Map POINTS, a CSV file with a header line (- is standard input), through CAMERA.

    To virtual or rays: columns u,v in px. To image: columns x,y in squares of the virtual plane, or x,y,z of rays. They
    may stand anywhere among other columns, which are ignored; rows keep their order. Every result has standard
    deviations; a result that does not exist is nan.
    """
    import numpy as np

    from pinholify.io.camera_file import read_camera
    from pinholify.io.point_tables import read_points, write_points

    if output != "-":
        check_output(Path(output), force=force, is_ours=is_answer, inputs=(camera, points))
    virtual_camera = read_camera(camera).camera
    dimensions = None if target == "image" else 2
    rows = read_points(sys.stdin if points == "-" else points, dimensions=dimensions, on_unused=say_unused)
    answer = np.full((len(rows), 4), np.nan)
    known = np.isfinite(rows).all(axis=1)
    answer[known] = mapped(virtual_camera, rows[known], target)
    write_points(sys.stdout if output == "-" else output, COLUMNS[target], answer)
    if output != "-":
        say(f"wrote {output}")
    missing = int(np.isnan(answer[:, :2]).any(axis=1).sum())
    if missing:
        say(f"{missing} of {len(answer)} points have no result (nan)")


def say_unused(names: list[str]) -> None:
    """Report input columns that were ignored, except the standard deviations of an earlier result."""
    others = [name for name in names if not name.startswith("std_")]
    if others:
        say(f"note: ignored columns: {', '.join(others)}; rows keep their number and order")


def mapped(camera: VirtualCamera, rows: Floats, target: str) -> Floats:
    """The results (n, 4) for ``rows`` (n, 2 or 3), in the columns ``COLUMNS[target]``."""
    import numpy as np

    if target == "rays":
        seen = camera.to_rays(rows)
        return np.column_stack([seen.directions, seen.std_px])
    if target == "virtual":
        points = camera.to_virtual(rows)
    else:
        points = camera.from_rays(rows) if rows.shape[1] == 3 else camera.from_virtual(rows)
    return np.column_stack([points.points, points.std])


def is_answer(path: Path) -> bool:
    """Whether the file looks like earlier output of this command."""
    with open(path, "rb") as file:
        start = file.read(64)
    return any(start.startswith((",".join(names) + "\n").encode()) for names in COLUMNS.values())
