"""Sessions: plain data, stored on disk so that a reload or a restart loses nothing.

::

    FOLDER/<session>/session.json            its settings and its last result
    FOLDER/<session>/<photograph>/           photograph.json, original, view.jpg, thumb.jpg
    FOLDER/<session>/solve-<id>/             camera.npz and map.npz of the last result
    FOLDER/<session>/arriving-<id>           a file that is being received or written; removed when the app starts

The app generates all names itself. JSON files are replaced as a whole.
"""

from __future__ import annotations

import json
import logging
import re
import secrets
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pinholify.board import Board, parse_board
from pinholify.corners import Corners, CornerSet
from pinholify.errors import BoardError
from pinholify.io.files import make_folder, writing_text

log = logging.getLogger("pinholify.web")

MAX_NAME_LENGTH = 120
DESCRIPTION, PHOTOGRAPH = "session.json", "photograph.json"


@dataclass(frozen=True, slots=True, eq=False)
class Photograph:
    """A photograph of a session; ``size`` (width, height) in px, ``bytes`` the size of its file.

    ``blur_px`` is the standard deviation of the blur, None without a board. ``suggestion`` is the size of another whole
    board that it shows.
    """

    id: str
    size: tuple[int, int]
    bytes: int
    corners: Corners
    blur_px: float | None = None
    suggestion: str | None = None
    included: bool = True

    @property
    def name(self) -> str:
        """Its name, unique in the session."""
        return self.corners.name


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """A set of photographs of one board by one camera, and the last ``result`` (JSON-serialisable).

    ``board`` is None until it is detected in a photograph; ``solve`` names the folder of the last result.
    """

    id: str
    created: float
    board: Board | None = None
    square_mm: float | None = None
    mirrored: bool = False
    photographs: tuple[Photograph, ...] = ()
    solve: str | None = None
    result: dict[str, Any] | None = field(default=None)

    def photograph(self, photograph_id: str) -> Photograph | None:
        """The photograph with that id."""
        return next((p for p in self.photographs if p.id == photograph_id), None)

    @property
    def usable(self) -> tuple[Photograph, ...]:
        """The included photographs that show the board and have the most frequent size."""
        found = [p for p in self.photographs if p.included and p.corners.found]
        sizes = [p.size for p in found]
        usual = max(sizes, key=sizes.count, default=None)
        return tuple(p for p in found if p.size == usual)

    def corner_set(self) -> CornerSet | None:
        """The corners of all usable photographs, None if there are none."""
        usable = self.usable
        if not usable or self.board is None:
            return None
        return CornerSet(self.board, usable[0].size, tuple(p.corners for p in usable))

    def free_name(self, wanted: str) -> str:
        """``wanted`` without folders, blanks and unsafe characters, made unique in the session."""
        last = re.split(r"[/\\]", wanted)[-1]
        stem = re.sub(r"[^\w.()+-]+", "_", last).strip("_.")[-MAX_NAME_LENGTH:] or "picture"
        taken, name, count = {p.name for p in self.photographs}, stem, 1
        while name in taken:
            count += 1
            name = f"{Path(stem).stem}-{count}{Path(stem).suffix}"
        return name

    def with_photograph(self, photograph: Photograph) -> Session:
        """The session with ``photograph`` in place of the one with its id, or appended."""
        if self.photograph(photograph.id) is None:
            return replace(self, photographs=(*self.photographs, photograph))
        changed = tuple(photograph if p.id == photograph.id else p for p in self.photographs)
        return replace(self, photographs=changed)

    def without_photograph(self, photograph_id: str) -> Session:
        """The session without that photograph."""
        return replace(self, photographs=tuple(p for p in self.photographs if p.id != photograph_id))


def new_id() -> str:
    """A random name that cannot be guessed and is valid on every file system."""
    return secrets.token_hex(8)


class Store:
    """The sessions in a folder; each is read on first access."""

    def __init__(self, folder: Path) -> None:
        """Creates ``folder`` if it does not exist; raises OutputError if it cannot."""
        self.folder = make_folder(folder)
        for left in self.folder.glob("arriving-*"):
            shutil.rmtree(left, ignore_errors=True)
        self._sessions: dict[str, Session] = {}

    def ids(self) -> list[str]:
        """The ids of all sessions, newest first."""
        found = [p.parent for p in self.folder.glob(f"*/{DESCRIPTION}")]
        return [p.name for p in sorted(found, key=lambda p: p.stat().st_mtime, reverse=True)]

    def create(self, board: Board | None, square_mm: float | None) -> Session:
        """A new, empty session."""
        session = Session(new_id(), time.time(), board, square_mm)
        make_folder(self.folder / session.id)
        self.put(session)
        return session

    def get(self, session_id: str) -> Session | None:
        """The session with that id, None if it does not exist or cannot be read."""
        if session_id not in self._sessions:
            if not re.fullmatch(r"[0-9a-f]{16}", session_id) or not (self.path(session_id) / DESCRIPTION).is_file():
                return None
            try:
                self._sessions[session_id] = self._read(session_id)
            except (KeyError, TypeError, ValueError, BoardError) as error:
                log.warning("the session in %s is damaged and was skipped: %r", self.path(session_id), error)
                return None
        return self._sessions[session_id]

    def put(self, session: Session) -> None:
        """Store ``session``; its photographs are stored by :meth:`put_photograph`."""
        self._sessions[session.id] = session
        data = {
            "created": session.created,
            "board": session.board.spec if session.board else None,
            "square_mm": session.square_mm,
            "mirrored": session.mirrored,
            "photographs": [p.id for p in session.photographs],
            "solve": session.solve,
            "result": session.result,
        }
        _write_json(self.path(session.id) / DESCRIPTION, data)

    def put_photograph(self, session: Session, photograph: Photograph) -> None:
        """Store the data of a photograph."""
        _write_json(self.path(session.id, photograph.id) / PHOTOGRAPH, photograph_to_json(photograph))

    def remove(self, session_id: str, *parts: str) -> None:
        """Remove the file or folder ``parts`` of a session; without ``parts``, the session itself."""
        if not parts:
            self._sessions.pop(session_id, None)
        path = self.path(session_id, *parts)
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)

    def path(self, session_id: str, *parts: str) -> Path:
        """The path of a session's folder, or of the file or folder ``parts`` in it."""
        return self.folder.joinpath(session_id, *parts)

    def arriving(self, session_id: str) -> Path:
        """A new path for a file or folder that is being received or written."""
        return self.path(session_id, f"arriving-{new_id()}")

    def _read(self, session_id: str) -> Session:
        data = json.loads((self.path(session_id) / DESCRIPTION).read_text(encoding="utf-8"))
        photographs = list(self._photographs(session_id, data["photographs"]))
        self._tidy(session_id, {*(p.id for p in photographs), data["solve"], DESCRIPTION})
        board = parse_board(data["board"]) if data["board"] else None
        return Session(
            session_id,
            data["created"],
            board,
            data["square_mm"],
            data["mirrored"],
            tuple(photographs),
            data["solve"],
            data["result"],
        )

    def _photographs(self, session_id: str, ids: list[str]) -> Iterator[Photograph]:
        for photograph_id in ids:
            path = self.path(session_id, photograph_id, PHOTOGRAPH)
            if path.is_file():
                yield _photograph_from_json(photograph_id, json.loads(path.read_text(encoding="utf-8")))

    def _tidy(self, session_id: str, known: set[str | None]) -> None:
        """Remove files that an interrupted run left."""
        for path in list(self.path(session_id).iterdir()):
            if path.name not in known:
                self.remove(session_id, path.name)


def photograph_to_json(photograph: Photograph) -> dict[str, Any]:
    """``photograph`` without its id, as JSON."""
    corners = photograph.corners
    return {
        "name": corners.name,
        "size": photograph.size,
        "bytes": photograph.bytes,
        "blur_px": photograph.blur_px,
        "suggestion": photograph.suggestion,
        "included": photograph.included,
        "reason": corners.reason,
        "ids": corners.ids.tolist(),
        "uv": corners.uv.tolist(),
        "weights": corners.weights.tolist(),
        "orientation_assumed": corners.orientation_assumed,
        "ambiguous_offset": corners.ambiguous_offset,
    }


def _photograph_from_json(photograph_id: str, data: dict[str, Any]) -> Photograph:
    corners = Corners(
        data["name"],
        np.array(data["ids"], dtype=np.int64),
        np.array(data["uv"], dtype=np.float64).reshape(-1, 2),
        np.array(data["weights"], dtype=np.float64),
        data["reason"],
        data["orientation_assumed"],
        data["ambiguous_offset"],
    )
    width, height = data["size"]
    return Photograph(
        photograph_id,
        (width, height),
        data["bytes"],
        corners,
        data["blur_px"],
        data["suggestion"],
        data["included"],
    )


def _write_json(path: Path, data: dict[str, Any]) -> None:
    with writing_text(path) as stream:
        json.dump(data, stream)
