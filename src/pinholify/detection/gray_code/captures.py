"""Folders of patterns with their manifest, and folders of captures."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pinholify.detection.gray_code.patterns import Sequence
from pinholify.detection.intensity import Grey, grey_levels
from pinholify.errors import ImageError, InputError, OutputError
from pinholify.io.files import make_folder, reading_text, writing_text
from pinholify.io.images import image_paths, read_image, write_image

MANIFEST = "patterns.json"
FORMAT_VERSION = 1


def write_patterns(folder: Path, sequence: Sequence) -> Iterator[Path]:
    """Write all pictures of ``sequence`` and then the manifest into ``folder``, lazily; yields each path.

    Raises OutputError if a file cannot be written.
    """
    make_folder(folder)
    for file, pattern in zip(sequence.files, sequence.patterns, strict=True):
        write_image(folder / file, sequence.picture(pattern))
        yield folder / file
    with writing_text(folder / MANIFEST) as stream:
        json.dump(manifest(sequence), stream, indent=1)
        stream.write("\n")
    yield folder / MANIFEST


def manifest(sequence: Sequence) -> dict[str, Any]:
    """The description of the pictures, for :func:`read_manifest` and for other programs."""
    return {
        "format_version": FORMAT_VERSION,
        "screen": list(sequence.size),
        "pixel_mm": sequence.pixel_mm,
        "wave_steps": sequence.steps,
        "wave_period": sequence.period,
        "patterns": list(sequence.files),
    }


def read_manifest(folder: Path) -> Sequence:
    """The sequence whose pictures are in ``folder``; raises InputError if its manifest cannot be used."""
    path = folder / MANIFEST if folder.is_dir() else folder
    with reading_text(path) as stream:
        text = stream.read()
    try:
        entries = json.loads(text)
        version = entries["format_version"]
        width, height = entries["screen"]
        numbers = int(width), int(height), int(entries["wave_steps"]), int(entries["wave_period"])
        pixel_mm = None if entries["pixel_mm"] is None else float(entries["pixel_mm"])
    except (ValueError, TypeError, KeyError):
        raise InputError(
            f"'{path}' is not a list of patterns; give the folder that 'pinholify gray-code make' wrote"
        ) from None
    if version != FORMAT_VERSION:
        raise InputError(
            f"'{path}' has format version {version} and this program reads {FORMAT_VERSION}: make the patterns again"
        )
    return Sequence(numbers[:2], numbers[2], numbers[3], pixel_mm)


def capture_paths(folder: Path, sequence: Sequence) -> list[Path]:
    """The captures in ``folder``, one per pattern, in the order of their names.

    Raises ImageError if there are more or fewer; the message names a missing one if the captures have the names of the
    patterns.
    """
    if not folder.is_dir():
        raise ImageError(f"'{folder}' is not a folder; give a folder with the captures of all patterns for each pose")
    paths = image_paths([folder])
    wanted = [Path(file).stem for file in sequence.files]
    missing = [stem for stem in wanted if stem not in {path.stem for path in paths}]
    if len(paths) == len(wanted):
        return paths
    found = f"'{folder}' holds {len(paths)} images where {len(wanted)} patterns were shown"
    if {path.stem for path in paths} < set(wanted):
        more = f" and {len(missing) - 1} more are" if len(missing) > 1 else " is"
        raise ImageError(f"{found}: the capture of '{missing[0]}'{more} missing; capture this pose again")
    raise ImageError(f"{found}: give one capture of each pattern, in their order, and no other images")


def read_captures(paths: list[Path], size: tuple[int, int] | None = None) -> Iterator[Grey]:
    """The captures (height, width) float32, 0 … 1, one after the other.

    Raises ImageError if one is not of ``size`` (width, height), by default the size of the first.
    """
    for path in paths:
        image = read_image(path)
        found = (image.shape[1], image.shape[0])
        size = size or found
        if found != size:
            raise ImageError(
                f"'{path}' is {found[0]}x{found[1]} and the captures before it are {size[0]}x{size[1]}: "
                "give captures of one camera at one size"
            )
        yield grey_levels(image) / np.float32(np.iinfo(image.dtype).max)


def check_new_folder(folder: Path, *, force: bool) -> None:
    """Raise OutputError if ``folder`` is a file, or a folder that is not empty unless ``force``."""
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"'{folder}' is a file; give a folder for the patterns")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise OutputError(f"'{folder}' is already there and not empty; choose another folder, or say --force")
