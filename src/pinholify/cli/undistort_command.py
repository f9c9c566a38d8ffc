"""``pinholify undistort``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import click

from pinholify.cli.options import SizeType, force_option, json_option, print_json, progress, say
from pinholify.errors import ImageError, InputError, OutputError, PinholifyError

JPEG = (".jpg", ".jpeg")


@click.command("undistort", epilog="Example: pinholify undistort camera.npz photos/*.jpg -o straight/ --max-std 1")
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
@click.option("--size", type=SizeType(), help="Size of the result in px; the image's by default.")
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
    from pinholify.io.images import image_paths
    from pinholify.rectification.straightener import Straightener

    paths = image_paths(images)
    targets = [output_path(folder, path) for path in paths]
    check_targets(paths, targets, force)
    straighten = Straightener(read_camera(camera).camera, view, size=size, method=method, max_std=max_std)
    prepare_folder(folder)
    failures: dict[str, str] = {}
    with progress("Straightening", len(paths)) as advance:
        for path, target in zip(paths, targets, strict=True):
            try:
                straighten_file(straighten, path, target)
            except OutputError:
                raise
            except PinholifyError as error:
                failures[str(path)] = str(error)
                say(f"{path}: {error}")
            advance()
    if as_json:
        done = [str(t) for p, t in zip(paths, targets, strict=True) if str(p) not in failures]
        print_json({"format_version": 1, "written": done, "failed": failures})
    else:
        click.echo(f"wrote {len(paths) - len(failures)} images into {folder}")
    if failures:
        raise ImageError(f"{len(failures)} of {len(paths)} images could not be straightened; see above")


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


def prepare_folder(folder: Path) -> None:
    """Make the folder if it is not there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder '{folder}' cannot be made: {error.strerror}; choose another") from None


def straighten_file(straighten, path: Path, target: Path) -> None:  # type: ignore[no-untyped-def]
    """One photograph from file to file."""
    from pinholify.io.images import read_image, write_image

    write_image(target, straighten(read_image(path)))
