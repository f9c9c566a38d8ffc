"""``pinholify map``."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from pinholify.cli.options import say


@click.command("map", epilog="Example: echo 'u,v\n100,200' | pinholify map camera.npz --to rays -")
@click.argument("camera", type=click.Path(path_type=Path))
@click.argument("points")
@click.option("--to", "target", type=click.Choice(["virtual", "image", "rays"]), required=True, help="What to map to.")
@click.option("-o", "output", default="-", show_default=True, help="CSV to write; - is standard output.")
def command(camera: Path, points: str, target: str, output: str) -> None:
    """Map POINTS, a CSV file with a header line (- is standard input), through CAMERA.

    To virtual or rays: columns u,v in px. To image: columns x,y in squares of the virtual plane, or x,y,z of rays.
    Standard deviations come with every answer; what does not exist is nan.
    """
    import numpy as np

    from pinholify.errors import OutputError
    from pinholify.io.camera_file import read_camera
    from pinholify.io.point_tables import read_points, write_points

    virtual_camera = read_camera(camera).camera
    rows = read_points(sys.stdin if points == "-" else points, dimensions=None if target == "image" else 2)
    if target == "rays":
        header, seen = ("x", "y", "z", "std_px"), virtual_camera.to_rays(rows)
        columns = np.column_stack([seen.directions, seen.std_px])
    else:
        if target == "virtual":
            header, mapped = ("x", "y", "std_x", "std_y"), virtual_camera.to_virtual(rows)
        elif rows.shape[1] == 3:
            header, mapped = ("u", "v", "std_u", "std_v"), virtual_camera.from_rays(rows)
        else:
            header, mapped = ("u", "v", "std_u", "std_v"), virtual_camera.from_virtual(rows)
        columns = np.column_stack([mapped.points, mapped.std])
    if output not in ("-", points) or output == "-":
        write_points(sys.stdout if output == "-" else output, header, columns)
    else:
        raise OutputError(f"'{output}' is the input as well; write to another file")
    missing = int((~np.isfinite(columns[:, :2])).any(axis=1).sum())
    if missing:
        say(f"{missing} of {len(columns)} points have no answer (nan)")
