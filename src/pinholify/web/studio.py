"""The app's sessions as a whole: made, changed, listed, ended."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

from pinholify.board import Board
from pinholify.web.calibrator import Calibrator
from pinholify.web.desk import Event
from pinholify.web.intake import Intake
from pinholify.web.limits import Limits, TooMuch
from pinholify.web.sessions import Session, Store
from pinholify.web.work import Crew
from pinholify.web.workroom import Workroom


class Studio:
    """All sessions in ``folder``, within ``limits``.

    Everything runs on the event loop's one thread and only changes plain data; what takes time goes to processes.
    """

    def __init__(self, folder: Path, limits: Limits, workers: int | None = None) -> None:
        """Reads what there is; ``workers`` processes at most, as many as suit this computer by default."""
        self.room = Workroom(Store(folder), Crew(workers), limits)
        self.calibrator = Calibrator(self.room)
        self.intake = Intake(self.room, self.calibrator)

    async def close(self) -> None:
        """End all work."""
        tasks = [task for desk in self.room.desks.values() for task in desk.tasks()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self.room.crew.close()

    def create(self, board: Board | None, square_mm: float | None) -> Session:
        """A new session; raises TooMuch where there are too many."""
        if len(self.room.store.ids()) >= self.room.limits.sessions:
            raise TooMuch(f"there are {self.room.limits.sessions} sessions already; delete one you no longer need")
        return self.room.store.create(board, square_mm)

    def delete(self, session_id: str) -> None:
        """End a session's work and remove all of it."""
        self.room.session(session_id)
        desk = self.room.desks.pop(session_id, None)
        for task in desk.tasks() if desk else []:
            task.cancel()
        self.room.store.remove(session_id)
        if desk:
            desk.tell("gone")

    def change(self, session_id: str, **changes: Any) -> None:
        """Change ``board``, ``square_mm`` or ``mirrored``; what depends on it is done again."""
        before = self.room.session(session_id)
        session = replace(before, **changes)
        self.room.put(session)
        if session.board != before.board or session.mirrored != before.mirrored:
            self.intake.look_again(session_id, [p.id for p in session.photographs])
        elif session.square_mm != before.square_mm:
            self.calibrator.want(session_id, at_once=True)

    def cancel(self, session_id: str) -> None:
        """End the session's long work; what was there before stays."""
        self.room.session(session_id)
        desk = self.room.desk(session_id)
        desk.wanted = False
        for task in desk.tasks():
            task.cancel()


def summary(session: Session) -> Event:
    """A session as it stands in the list of all."""
    result = session.result or {}
    shown = max(session.photographs, key=lambda p: p.corners.found, default=None)
    return {
        "id": session.id,
        "created": session.created,
        "board": session.board.spec if session.board else None,
        "photographs": len(session.photographs),
        "f_px": result.get("f_px"),
        "level": result.get("level"),
        "thumb": shown and shown.id,
    }
