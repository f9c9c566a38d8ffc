"""Reading text, and writing files so that a failure leaves the previous file in place."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO, TypeAlias

from pinholify.errors import InputError, OutputError

TextFile: TypeAlias = "str | os.PathLike[str] | TextIO"
"""A path, or a text stream that the caller opens and closes."""

_ADVICE = {
    errno.ENOENT: "its folder does not exist; create the folder first or choose another",
    errno.ENOTDIR: "part of its path is a file, not a folder; choose another place",
    errno.EISDIR: "it is a folder; name a file in it",
    errno.EACCES: "permission is denied; choose a place you may write to",
    errno.EPERM: "permission is denied; choose a place you may write to",
    errno.EROFS: "its file system is read-only; choose another place",
    errno.ENOSPC: "the disk is full; free some space or choose another place",
    errno.EDQUOT: "your disk quota is used up; free some space or choose another place",
    errno.ENAMETOOLONG: "its name is too long; choose a shorter one",
}


def cannot_write(path: str | os.PathLike[str], error: OSError) -> OutputError:
    """The OutputError for an ``error`` that occurred while writing ``path``."""
    advice = _ADVICE.get(error.errno or 0, f"{error.strerror or error}; choose another place")
    return OutputError(f"'{os.fspath(path)}' cannot be written: {advice}")


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A new, empty file next to ``path`` to write to; it replaces ``path`` when the block succeeds.

    The temporary file has the ending of ``path``, for writers that choose the format by it. If the block fails, the
    temporary file is removed and ``path`` is left unchanged. Links are followed. Raises OutputError if the file cannot
    be written, before the block runs if possible; an OSError inside the block counts as a failure to write.
    """
    try:
        final = _writable(Path(path))
        temporary = final.with_name(f".{final.stem[:60]}-{secrets.token_hex(6)}{final.suffix}")
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    except OSError as error:
        raise cannot_write(path, error) from error
    try:
        yield temporary
        temporary.replace(final)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def _writable(path: Path) -> Path:
    """``path`` with its links followed; raises OSError if it must not be replaced by a file."""
    final = Path(os.path.realpath(path))
    if final.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if final.exists() and not final.is_file():
        raise OSError(errno.ENOTSUP, "it is a device or a pipe, and only a file can be replaced")
    if final.exists() and not os.access(final, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    return final


def make_folder(folder: Path) -> Path:
    """Create ``folder`` and its parents if needed, and return it; raises OutputError if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder '{folder}' cannot be created: {error.strerror}; choose another folder") from None
    return folder


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise OutputError if :func:`atomic_path` would: a check before the work whose result will be written."""
    with suppress(_Unused), atomic_path(path):
        raise _Unused


class _Unused(Exception):
    """Ends a trial of :func:`atomic_path`."""


@contextmanager
def writing_text(target: TextFile) -> Iterator[TextIO]:
    """A UTF-8 stream to ``target``: the stream itself, or a file that appears when the block succeeds.

    Raises OutputError if the file cannot be written.
    """
    if not isinstance(target, str | os.PathLike):
        yield target
        return
    with atomic_path(target) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as stream:
        yield stream


@contextmanager
def reading_text(source: TextFile, error: type[InputError] = InputError) -> Iterator[TextIO]:
    """A text stream that reads ``source`` as UTF-8, with or without a byte order mark.

    Raises ``error`` if the file does not exist, cannot be read, or is not text.
    """
    name = source_name(source)
    try:
        if not isinstance(source, str | os.PathLike):
            yield source
            return
        with open(source, encoding="utf-8-sig") as stream:
            yield stream
    except FileNotFoundError:
        raise error(f"there is no file '{name}'; check the path") from None
    except IsADirectoryError:
        raise error(f"'{name}' is a folder where a text file is needed; name a file in it") from None
    except UnicodeDecodeError as found:
        raise error(f"'{name}' is not text in UTF-8 ({found.reason}); name a plain text file") from None
    except OSError as found:
        why = found.strerror or found
        raise error(f"'{name}' cannot be read: {why}; check the file and its permissions") from found


def source_name(source: TextFile) -> str:
    """The name of ``source`` in messages."""
    if isinstance(source, str | os.PathLike):
        return os.fspath(source)
    name = getattr(source, "name", "")
    return "standard input" if name in ("", "<stdin>", 0) else str(name)
