"""The sessions of the app: creating, changing, listing and deleting them."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

from pinholify.board import Board
from pinholify.web.calibrator import Calibrator
from pinholify.web.context import AppContext
from pinholify.web.limits import LimitExceeded, Limits
from pinholify.web.process_pool import ProcessPool
from pinholify.web.session_state import Event
from pinholify.web.sessions import Session, Store
from pinholify.web.uploads import Uploads


class SessionManager:
    """All sessions in ``folder``, within ``limits``.

    Everything here runs in the thread of the event loop and only changes plain data; long work goes to processes.
    """

    def __init__(self, folder: Path, limits: Limits, workers: int | None = None) -> None:
        """Opens ``folder``; ``workers`` is the number of processes, by default one that suits this computer."""
        self.context = AppContext(Store(folder), ProcessPool(workers), limits)
        self.calibrator = Calibrator(self.context)
        self.uploads = Uploads(self.context, self.calibrator)

    async def close(self) -> None:
        """Cancel all work and end the processes."""
        tasks = [task for state in self.context.states.values() for task in state.tasks()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self.context.pool.close()

    def create(self, board: Board | None, square_mm: float | None) -> Session:
        """A new session; raises LimitExceeded if there are too many."""
        most = self.context.limits.sessions
        if len(self.context.store.ids()) >= most:
            raise LimitExceeded(f"there are already {most} sessions; delete one that you no longer need")
        return self.context.store.create(board, square_mm)

    def delete(self, session_id: str) -> None:
        """Cancel a session's work and delete the session with its files."""
        self.context.session(session_id)
        state = self.context.states.pop(session_id, None)
        for task in state.tasks() if state else []:
            task.cancel()
        self.context.store.remove(session_id)
        if state:
            state.publish("gone")

    def change(self, session_id: str, **changes: Any) -> None:
        """Change ``board``, ``square_mm`` or ``mirrored``, and repeat what depends on them."""
        before = self.context.session(session_id)
        session = replace(before, **changes)
        self.context.put(session)
        if session.board != before.board or session.mirrored != before.mirrored:
            self.uploads.inspect_again(session_id, [p.id for p in session.photographs])
        elif session.square_mm != before.square_mm:
            self.calibrator.request(session_id, at_once=True)

    def cancel(self, session_id: str) -> None:
        """Cancel the session's long work; earlier results stay."""
        self.context.session(session_id)
        state = self.context.state(session_id)
        state.requested = False
        for task in state.tasks():
            task.cancel()


def summary(session: Session) -> Event:
    """A session as an entry of the list of sessions."""
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
