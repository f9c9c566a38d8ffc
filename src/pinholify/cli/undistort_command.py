"""``pinholify undistort``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pinholify.cli import options
from pinholify.cli.options import examples, force_option, json_option, print_json, progress, say
from pinholify.errors import ImageError, InputError, OutputError

if TYPE_CHECKING:  # loads NumPy, which no --help should wait for
    from pinholify.rectification.straightener import Straightener

JPEG = (".jpg", ".jpeg")


@click.command("undistort", epilog=examples("pinholify undistort camera.npz photos/*.jpg -o straight/ --max-std 1"))
@click.argument("camera", type=click.Path(path_type=Path))
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "folder", type=click.Path(path_type=Path), required=True, help="Folder to write into.")
@click.option(
    "--view",
    type=click.Choice(["camera", "board"]),
    default="camera",
    show_default=True,
    help="Look along the optical axis, or straight at the reference board.",
)
@click.option("--size", type=options.size, metavar="WxH", help="Size of the result in px; the image's by default.")
@click.option(
    "--method",
    type=click.Choice(["remap", "splat"]),
    default="remap",
    show_default=True,
    help="Interpolate backwards, or the paper's forward splat with a median filter.",
)
@click.option(
    "--max-std",
    type=click.FloatRange(min=0, min_open=True),
    help="Show what is known to this many px, instead of the camera's domain.",
)
@json_option
@force_option
def command(
    camera: Path,
    images: tuple[Path, ...],
    folder: Path,
    view: str,
    size: tuple[int, int] | None,
    method: str,
    max_std: float | None,
    as_json: bool,
    force: bool,
) -> None:
    """Straighten IMAGES (files or folders) of CAMERA into a folder: PNG, or JPEG for JPEG input.

    What lies outside the camera's domain, or above --max-std, is black. An image that fails is reported and the rest
    are done; the exit status is then 1.
    """
    from pinholify.io.camera_file import read_camera
    from pinholify.io.files import check_writable, make_folder
    from pinholify.io.images import image_paths
    from pinholify.rectification.straightener import Straightener

    paths = image_paths(images)
    targets = [output_path(folder, path) for path in paths]
    check_targets(paths, targets, force)
    straighten = Straightener(read_camera(camera).camera, view, size=size, method=method, max_std=max_std)
    make_folder(folder)
    for target in targets:
        check_writable(target)
    failures: dict[str, str] = {}
    with progress("Straightening", len(paths)) as advance:
        for path, target in zip(paths, targets, strict=True):
            try:
                straighten_file(straighten, path, target)
            except ImageError as error:
                failures[str(path)] = str(error)
            advance()
    if as_json:
        done = [str(t) for p, t in zip(paths, targets, strict=True) if str(p) not in failures]
        print_json({"format_version": 1, "written": done, "failed": failures})
    elif len(failures) < len(paths):
        click.echo(f"wrote {len(paths) - len(failures)} images into {folder}")
    if failures:
        raise ImageError(summary_of(failures, len(paths)))


def summary_of(failures: dict[str, str], total: int) -> str:
    """One sentence about images that failed; where there are several, all are listed before it."""
    if len(failures) > 1:
        for error in failures.values():
            say(error)
    first = next(iter(failures.values()))
    return first if total == 1 else f"{len(failures)} of {total} images could not be straightened: {first}"


def output_path(folder: Path, path: Path) -> Path:
    """DIR/stem.png, or .jpg for JPEG input."""
    return folder / (path.stem + (path.suffix if path.suffix.lower() in JPEG else ".png"))


def check_targets(paths: list[Path], targets: list[Path], force: bool) -> None:
    """Refuse, before any work, names that clash, files that are there, and the inputs themselves."""
    twice = [str(t) for t, n in Counter(targets).items() if n > 1]
    if twice:
        raise InputError(f"two images would both be written as '{twice[0]}'; rename one, or do them in two runs")
    inputs = {p.resolve() for p in paths}
    if any(t.resolve() in inputs for t in targets):
        raise OutputError("the results would replace the photographs themselves; choose another folder with -o")
    there = [t for t in targets if t.exists()]
    if there and not force:
        raise OutputError(f"'{there[0]}' is already there ({len(there)} in all); choose another folder, or say --force")


def straighten_file(straighten: Straightener, path: Path, target: Path) -> None:
    """One photograph from file to file; raises ImageError, which names it, for one that is no image of the camera."""
    from pinholify.io.images import read_image, write_image

    image = read_image(path)
    try:
        straight = straighten(image)
    except ImageError as error:
        raise ImageError(f"'{path}': {error}") from None
    write_image(target, straight)
