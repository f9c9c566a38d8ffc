"""The commands ``pinholify gray-code make`` and ``decode``: patterns for a screen, and corners from their captures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli import options
from pinholify.cli.options import (
    check_output,
    examples,
    force_option,
    json_option,
    overwrite_option,
    print_json,
    progress,
    say,
)
from pinholify.errors import ImageError

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.detection.gray_code import Decoded, ScreenMap, Sequence


@click.group(
    "gray-code",
    epilog=examples(
        "pinholify gray-code make --screen 1920x1080 -o patterns/",
        "pinholify gray-code decode pose1/ pose2/ pose3/ --patterns patterns/",
    ),
)
def command() -> None:
    """Use a screen as a calibration target: thousands of points wherever the camera sees it.

    Show the patterns one after the other, full screen and unscaled, and photograph each; then move the screen or the
    camera, and repeat. Camera and screen must not move within a pose; keep exposure and focus fixed.
    """


@command.command(
    "make",
    epilog=examples(
        "pinholify gray-code make --screen 1920x1080 --pixel 0.2745mm -o patterns/",
        "pinholify gray-code make --screen 3840x2160 --waves 0 -o patterns/",
    ),
)
@click.option("--screen", type=options.size, required=True, metavar="WxH", help="Size of the screen in px.")
@click.option("--pixel", "pixel_mm", type=options.length, help="Pixel pitch of the screen, e.g. 0.2745mm.")
@click.option(
    "--waves",
    "steps",
    type=int,
    default=8,
    show_default=True,
    help="Phase steps of the waves that resolve fractions of a screen pixel; 0 for Gray codes alone.",
)
@click.option("--period", type=int, default=32, show_default=True, help="Period of the waves in screen px: 8, 16, …")
@click.option("-o", "folder", type=click.Path(path_type=Path), required=True, help="Folder to write into.")
@overwrite_option
def make(screen: tuple[int, int], pixel_mm: float | None, steps: int, period: int, folder: Path, force: bool) -> None:
    """Write the pictures to show, numbered in order, and patterns.json, which decode needs."""
    from pinholify.detection.gray_code import Sequence, write_patterns
    from pinholify.detection.gray_code.captures import check_new_folder

    sequence = Sequence(screen, steps, period, pixel_mm)
    check_new_folder(folder, force=force)
    with progress("Drawing", len(sequence.patterns) + 1) as advance:
        for _ in write_patterns(folder, sequence):
            advance()
    click.echo(f"wrote {len(sequence.patterns)} pictures for a screen of {screen[0]}x{screen[1]} px into {folder}")


@command.command(
    "decode", epilog=examples("pinholify gray-code decode pose1/ pose2/ pose3/ pose4/ --patterns patterns/")
)
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--patterns", type=click.Path(path_type=Path), required=True, help="Folder written by make.")
@click.option(
    "--spacing",
    type=click.IntRange(4),
    default=16,
    show_default=True,
    help="Distance between nodes in screen px; each node is located by all the pixels around it.",
)
@click.option(
    "-o",
    "output",
    type=click.Path(path_type=Path),
    default="corners.csv",
    show_default=True,
    help="Table to write: filename,X,Y,u,v,std; or a corner table if the name ends in .vnl.",
)
@click.option("--maps", type=click.Path(path_type=Path), help="Also write what each pixel sees, into this folder.")
@json_option
@force_option
def decode(
    folders: tuple[Path, ...],
    patterns: Path,
    spacing: int,
    output: Path,
    maps: Path | None,
    as_json: bool,
    force: bool,
) -> None:
    """Locate the nodes of the screen in captures of all patterns, in one folder per pose (FOLDERS).

    The captures of a pose are taken in the natural order of their file names.

    With --maps, NAME.npz holds x and y (height x width): the screen coordinates that each pixel sees, nan where
    unknown.
    """
    from pinholify.cli.detect_command import to_json
    from pinholify.detection.gray_code import decode_folders, read_manifest

    is_ours = _readers(output)
    check_output(output, force=force, is_ours=is_ours)
    sequence = read_manifest(patterns)
    with progress("Decoding", len(folders) * len(sequence.patterns)) as advance:
        decoded = decode_folders(
            folders, sequence, spacing=spacing, on_capture=advance, on_pose=_map_writer(maps, force)
        )
    _check_found(decoded)
    _write(output, decoded)
    if as_json:
        print_json(to_json(decoded.corners) | {"std_px": decoded.std_px})
    else:
        _summary(output, decoded, sequence)


def _readers(output: Path) -> Callable[[Path], bool]:
    """The function that recognises an earlier result of the same kind as ``output``."""
    from pinholify.cli.sources import is_corner_table
    from pinholify.io.correspondence_tables import is_correspondence_table

    return is_corner_table if output.suffix == ".vnl" else is_correspondence_table


def _map_writer(folder: Path | None, force: bool) -> Callable[[str, ScreenMap], object]:
    """A callback that writes the map of each pose into ``folder``, or does nothing if that is None."""
    import numpy as np

    from pinholify.io.files import atomic_path, make_folder

    def write(name: str, seen: ScreenMap) -> None:
        if folder is None:
            return
        path = make_folder(folder) / f"{name.replace('/', '-')}.npz"
        check_output(path, force=force)
        with atomic_path(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, x=seen.x, y=seen.y)

    return write


def _check_found(decoded: Decoded) -> None:
    """Report the poses that show no screen; raise ImageError if none shows one."""
    views = decoded.corners.views
    for view in views:
        if not view.found:
            say(f"{view.name}: {view.reason}")
    if not decoded.corners.found:
        raise ImageError(f"no screen was found in any of the {len(views)} poses: {views[0].reason}")


def _write(output: Path, decoded: Decoded) -> None:
    from pinholify.io.corner_tables import write_corner_table
    from pinholify.io.correspondence_tables import write_correspondences

    if output.suffix == ".vnl":
        write_corner_table(output, decoded.corners)
    else:
        write_correspondences(output, decoded.corners, decoded.std_px)


def _summary(output: Path, decoded: Decoded, sequence: Sequence) -> None:
    """Print what was found, and the command to run next."""
    corners = decoded.corners
    nodes, (width, height) = sum(map(len, corners.found)), corners.image_size
    click.echo(
        f"wrote {output}: {nodes} nodes in {len(corners.found)} of {len(corners.views)} poses, typical standard "
        f"deviation {decoded.std_px:.2g} px"
    )
    spacing = int(corners.board.spec.rpartition(":")[2])
    square = "" if sequence.pixel_mm is None else f" --square {spacing * sequence.pixel_mm:g}mm"
    click.echo(
        f"next: pinholify calibrate --corners {output} --board {corners.board.spec} "
        f"--image-size {width}x{height}{square}"
    )
