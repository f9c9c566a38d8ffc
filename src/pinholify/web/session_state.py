"""The live state of a session: its open pages, its running work, and the events that pages receive."""

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

JUDGED = ("level", "sentence", "findings", "next", "heldout_px")  # kept from a result until the next is judged
QUIET = 0.4  # seconds without a new photograph after which no more are expected


@dataclass(slots=True, eq=False)
class SessionState:
    """The state of a session that is not stored on disk.

    ``subscribers`` are the event queues of open pages. ``inspecting`` counts the photographs that are being inspected,
    and ``last_arrival`` is when the last one was finished (event loop time). ``activity`` describes the long work that
    is running, ``problem`` why there is no camera yet; ``preview`` is an intermediate result, in the folder
    ``preview_solve``. ``previous`` are the corners of the last live frame. ``requested`` means that a calibration is to
    be started.
    """

    session_id: str
    subscribers: set[asyncio.Queue[Event]] = field(default_factory=set)
    inspecting: int = 0
    last_arrival: float = 0.0
    activity: Event | None = None
    problem: str | None = None
    preview: Event | None = None
    preview_solve: str | None = None
    previous: Corners | None = None
    requested: bool = False
    solver: asyncio.Task[None] | None = None
    solve_job: asyncio.Task[Any] | None = None
    inspection_job: asyncio.Task[None] | None = None
    video_job: asyncio.Task[None] | None = None
    report_job: asyncio.Task[Any] | None = None

    def publish(self, kind: str, **data: object) -> None:
        """Send an event to all open pages."""
        for queue in self.subscribers:
            queue.put_nowait({"kind": kind, **data})

    def set_activity(self, text: str | None, share: float | None = None) -> None:
        """Publish which long work is running and the ``share`` that is done; None when it has ended."""
        self.activity = None if text is None else {"text": text, "share": share}
        self.publish("activity", activity=self.activity)

    @contextmanager
    def subscribe(self) -> Iterator[asyncio.Queue[Event]]:
        """A queue that receives all events from now on."""
        queue: asyncio.Queue[Event] = asyncio.Queue()
        self.subscribers.add(queue)
        try:
            yield queue
        finally:
            self.subscribers.discard(queue)

    def idle(self) -> bool:
        """Whether no more photographs are expected."""
        return not self.inspecting and asyncio.get_running_loop().time() - self.last_arrival > QUIET

    def tasks(self) -> list[asyncio.Task[Any]]:
        """The tasks that are running."""
        tasks = (self.solver, self.solve_job, self.inspection_job, self.video_job, self.report_job)
        return [task for task in tasks if task is not None and not task.done()]


def session_event(session: Session) -> Event:
    """What pages show of a session, apart from its photographs and its result."""
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


def result_event(session: Session, state: SessionState) -> Event:
    """The newest result, and why there is no newer one if so."""
    result = state.preview or session.result
    if state.preview and session.result and state.preview["stage"] != "evaluated":
        result = {**state.preview, **{name: session.result.get(name) for name in JUDGED}}
    return {
        "result": result,
        "solve": state.preview_solve or session.solve,
        "final": state.preview is None and result is not None,
        "accepted": session.result is not None and guidance.good_enough(session.result),
        "problem": state.problem,
        "pending": state.requested,
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
    """The postures of the boards in all usable photographs."""
    if session.board is None:
        return []
    return [guidance.posture(p.corners, session.board, p.size) for p in session.usable]
