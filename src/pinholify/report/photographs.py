"""Matching files with the photographs of a camera, by name: among given files, or next to the camera file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from pinholify.errors import InputError


@dataclass(frozen=True, slots=True)
class Photographs:
    """Files ``by_name`` of the camera's views, and the ``others``, which match no view."""

    by_name: dict[str, Path] = field(default_factory=dict)
    others: tuple[Path, ...] = ()


def matched(names: Sequence[str], paths: Iterable[Path]) -> Photographs:
    """Match ``paths`` with view ``names``: a file's name, preceded by folders where names would not be unique.

    Raises InputError where two files match one name.
    """
    found: dict[str, Path] = {}
    others = []
    for path in paths:
        name = _name_of(path, names)
        if name is None:
            others.append(path)
        elif name in found:
            raise InputError(f"both '{found[name]}' and '{path}' are called '{name}'; give one of them")
        else:
            found[name] = path
    return Photographs(found, tuple(others))


def _name_of(path: Path, names: Sequence[str]) -> str | None:
    """The longest of ``names`` with which ``path`` ends."""
    parts = path.absolute().parts
    fits = [name for name in names if (p := PurePosixPath(name).parts) and parts[-len(p) :] == p]
    return max(fits, key=len, default=None)


def nearby(names: Sequence[str], folders: Sequence[Path]) -> Photographs:
    """The ``names`` that are files in one of ``folders``; names that lead out of a folder are ignored."""
    found: dict[str, Path] = {}
    for name in names:
        place = PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts:
            continue
        files = (folder / place for folder in folders)
        path = next((file for file in files if file.is_file()), None)
        if path is not None:
            found[name] = path
    return Photographs(found)
