"""What goes on in one session: who watches, what is being worked on, and what it is to be told."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from pinholify.corners import Corners
from pinholify.web import guidance
from pinholify.web.sessions import Photograph, Session

Event = dict[str, Any]

JUDGED = ("level", "sentence", "next", "heldout_px")  # what of a result stays until the next is judged
QUIET = 0.4  # seconds without a new photograph after which no more are expected


@dataclass(slots=True, eq=False)
class Desk:
    """The state of one session that is not kept: open pages, running work, the picture before this one.

    ``looking`` counts photographs that are being looked at and ``last_look`` is when the last one was done;
    ``activity`` is the long work under way, ``problem`` why there is no camera yet, ``preview`` a result on its way to
    the session's.
    """

    session_id: str
    watchers: set[asyncio.Queue[Event]] = field(default_factory=set)
    looking: int = 0
    last_look: float = 0.0
    activity: Event | None = None
    problem: str | None = None
    preview: Event | None = None
    preview_solve: str | None = None
    previous: Corners | None = None
    wanted: bool = False
    solver: asyncio.Task[None] | None = None
    solve_job: asyncio.Task[Any] | None = None
    look_job: asyncio.Task[None] | None = None
    video_job: asyncio.Task[None] | None = None
    report_job: asyncio.Task[Any] | None = None

    def tell(self, kind: str, **what: object) -> None:
        """An event for all open pages."""
        for queue in self.watchers:
            queue.put_nowait({"kind": kind, **what})

    def act(self, text: str | None, share: float | None = None) -> None:
        """Say what long work is under way, None where there is none any more."""
        self.activity = None if text is None else {"text": text, "share": share}
        self.tell("activity", activity=self.activity)

    @contextmanager
    def watching(self) -> Iterator[asyncio.Queue[Event]]:
        """A queue of all events from now on."""
        queue: asyncio.Queue[Event] = asyncio.Queue()
        self.watchers.add(queue)
        try:
            yield queue
        finally:
            self.watchers.discard(queue)

    def quiet(self) -> bool:
        """Whether no photographs are arriving."""
        return not self.looking and asyncio.get_running_loop().time() - self.last_look > QUIET

    def tasks(self) -> list[asyncio.Task[Any]]:
        """Everything that runs."""
        tasks = (self.solver, self.solve_job, self.look_job, self.video_job, self.report_job)
        return [task for task in tasks if task is not None and not task.done()]


def session_event(session: Session) -> Event:
    """What pages show of a session beside its photographs and result."""
    postures = postures_of(session)
    covered = guidance.bars(postures)
    usable = session.usable
    return {
        "id": session.id,
        "created": session.created,
        "board": None
        if session.board is None
        else {"spec": session.board.spec, "columns": session.board.columns, "rows": session.board.rows},
        "square_mm": session.square_mm,
        "mirrored": session.mirrored,
        "size": usable[0].size if usable else None,
        "usable": [p.id for p in usable],
        "bars": covered,
        "advice": guidance.advice(covered, postures),
    }


def result_event(session: Session, desk: Desk) -> Event:
    """The result that pages show, the newest there is, and what stands in the way of another."""
    result = desk.preview or session.result
    if desk.preview and session.result and desk.preview["stage"] != "evaluated":
        result = {**desk.preview, **{name: session.result[name] for name in JUDGED}}
    return {
        "result": result,
        "solve": desk.preview_solve or session.solve,
        "final": desk.preview is None and result is not None,
        "accepted": session.result is not None and guidance.content(session.result),
        "problem": desk.problem,
        "pending": desk.wanted,
    }


def photograph_event(photograph: Photograph) -> Event:
    """What pages show of a photograph."""
    corners = photograph.corners
    return {
        "id": photograph.id,
        "name": photograph.name,
        "size": photograph.size,
        "included": photograph.included,
        "found": corners.found,
        "reason": corners.reason,
        "suggestion": photograph.suggestion,
        "blur_px": photograph.blur_px,
        "ids": corners.ids.tolist(),
        "uv": corners.uv.round(2).tolist(),
        "assumed": corners.orientation_assumed,
        "ambiguous": corners.ambiguous_offset,
    }


def postures_of(session: Session) -> list[guidance.Posture]:
    """How the boards of all usable photographs stand."""
    if session.board is None:
        return []
    return [guidance.posture(p.corners, session.board, p.size) for p in session.usable]
