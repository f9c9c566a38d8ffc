"""Reading and writing bytes at a place: a local path, or a URL of any storage that fsspec supports (extra ``cluster``).

A text with ``://`` is a URL, such as ``s3://…``, ``gcs://…`` or ``memory://…``. Paths need no extra.
"""

from __future__ import annotations

import os
import posixpath
import secrets
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from pinholify.errors import ImageError, InputError, OutputError, PinholifyError
from pinholify.io import images
from pinholify.io.files import atomic_path


def is_url(place: str) -> bool:
    """Whether ``place`` is a URL, which is accessed through fsspec."""
    return "://" in place


def absolute(place: str) -> str:
    """``place`` in a form that is valid in any working folder."""
    return place if is_url(place) else os.path.abspath(place)


def real(place: str) -> str:
    """The canonical name of ``place``: a path is made absolute and its links are followed."""
    return place if is_url(place) else os.path.realpath(place)


def inside(folder: str, name: str) -> str:
    """The place ``name`` in ``folder``."""
    return f"{folder.rstrip('/')}/{name}" if is_url(folder) else str(Path(folder) / name)


def name_of(place: str) -> str:
    """The last part of ``place``."""
    return posixpath.basename(place) if is_url(place) else Path(place).name


def image_places(arguments: Iterable[str]) -> list[str]:
    """The images of ``arguments``, with folders and folder URLs replaced by the images in them, in natural order.

    Raises ImageError as :func:`pinholify.io.images.image_paths` does, and if a storage cannot be read.
    """
    places: list[str] = []
    for remote, some in _by_storage(arguments):
        places += [place for url in some for place in _listed(url)] if remote else map(str, images.image_paths(some))
    return places


def _by_storage(places: Iterable[str]) -> Iterator[tuple[bool, list[str]]]:
    """Yield (is remote, places) for runs of neighbouring ``places`` in the same storage, in order."""
    for storage, some in groupby(places, lambda place: urlsplit(place)[:2] if is_url(place) else ()):
        yield bool(storage), list(some)


def _listed(url: str) -> list[str]:
    files, path = _storage(url)
    with _failing(ImageError, f"'{url}' cannot be read"):
        if not files.isdir(path):
            return [url]
        names = [files.unstrip_protocol(name) for name in files.ls(path, detail=False)]
    found = sorted((n for n in names if Path(n).suffix.lower() in images.IMAGE_SUFFIXES), key=images.natural_order)
    if not found:
        raise ImageError(f"the folder '{url}' holds no images; give one that does, or image files")
    return found


def read_bytes(place: str) -> bytes:
    """The content of ``place``; raises ImageError if it cannot be read."""
    if not is_url(place):
        return images.read_bytes(place)
    files, path = _storage(place)
    with _failing(ImageError, f"'{place}' cannot be read"):
        return bytes(files.cat_file(path))


def write_bytes(place: str, data: bytes) -> None:
    """Write ``data`` to ``place``, completely or not at all; raises OutputError if it cannot be written.

    URLs too are written under a temporary name and then moved, because not every storage writes an object atomically.
    """
    if not is_url(place):
        with atomic_path(place) as temporary:
            temporary.write_bytes(data)
        return
    files, path = _storage(place)
    folder, name = posixpath.split(path)
    temporary_path = posixpath.join(folder, f".{secrets.token_hex(6)}-{name}")
    with _failing(OutputError, f"'{place}' cannot be written"):
        try:
            files.makedirs(folder, exist_ok=True)
            files.pipe_file(temporary_path, data)
            files.mv(temporary_path, path)
        except BaseException:
            with suppress(Exception):
                files.rm(temporary_path)
            raise


def beginnings(places: Sequence[str], count: int) -> list[bytes | None]:
    """The first ``count`` bytes at each of ``places``, None if it does not exist; a storage is queried in bulk.

    Raises ImageError if a storage cannot be read.
    """
    found: list[bytes | None] = []
    for remote, some in _by_storage(places):
        found += _url_beginnings(some, count) if remote else [_file_beginning(path, count) for path in some]
    return found


def _file_beginning(path: str, count: int) -> bytes | None:
    try:
        with open(path, "rb") as file:
            return file.read(count)
    except OSError:
        return b"" if os.path.lexists(path) else None


def _url_beginnings(urls: list[str], count: int) -> list[bytes | None]:
    files, _ = _storage(urls[0])
    paths = [_storage(url)[1] for url in urls]
    with _failing(ImageError, f"'{urls[0]}' cannot be looked for"):
        folders = [folder for folder in {posixpath.dirname(path) for path in paths} if files.isdir(folder)]
        there = {name.lstrip("/") for folder in folders for name in files.ls(folder, detail=False)}
        known = [path for path in paths if path.lstrip("/") in there]
        starts = dict(zip(known, files.cat_ranges(known, 0, count, on_error="raise"), strict=True))
    return [starts.get(path) for path in paths]


def sizes(places: Sequence[str]) -> list[int | None]:
    """The size of each of ``places`` in bytes, None if unknown."""
    found: list[int | None] = []
    for remote, some in _by_storage(places):
        found += _url_sizes(some) if remote else [_file_size(path) for path in some]
    return found


def _file_size(path: str) -> int | None:
    try:
        return os.path.getsize(path)
    except OSError:
        return None


def _url_sizes(urls: list[str]) -> list[int | None]:
    files, _ = _storage(urls[0])
    try:
        return list(files.sizes([_storage(url)[1] for url in urls]))
    except Exception:  # every storage has its own errors; one missing file must not hide the others
        return [None] if len(urls) == 1 else [size for url in urls for size in _url_sizes([url])]


def _storage(url: str) -> tuple[Any, str]:
    """fsspec's file system for ``url``, and the path in it; raises InputError if there is none."""
    try:
        import fsspec
    except ImportError:
        raise InputError(f"'{url}' needs fsspec, which is not installed: pip install 'pinholify[cluster]'") from None
    try:
        files, path = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise InputError(f"'{url}' cannot be reached: {error}; install the package for such URLs") from None
    return files, path


@contextmanager
def _failing(kind: type[PinholifyError], what: str) -> Iterator[None]:
    """Convert any error of a storage to ``kind``; most storages do not raise OSError."""
    try:
        yield
    except FileNotFoundError:
        raise kind(f"{what}: there is no such file; check the name") from None
    except Exception as error:
        raise kind(f"{what}: {str(error) or type(error).__name__}; check the URL and your access to it") from error
