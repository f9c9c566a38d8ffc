"""When a session is calibrated, and what becomes of the result."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pinholify.errors import InputError
from pinholify.web import downloads, solving
from pinholify.web.desk import Desk, Event, result_event
from pinholify.web.sessions import new_id
from pinholify.web.workroom import NotThere, Workroom

ENOUGH_FOR_A_LOOK = 6  # boards from which on a first result is made while more photographs arrive
POLL = 0.05  # seconds
STEPS = {
    "first": "A first look with {} photographs is there; finding the camera that suits them best",
    "camera": "Checking the camera of {} photographs on boards that it has not seen",
}
"""What is done once a stage of a calibration is there."""


class Calibrator:
    """Calibrates the sessions of a ``room``, one calibration at a time in each."""

    def __init__(self, room: Workroom) -> None:
        """Works in ``room``."""
        self.room = room

    def want(self, session_id: str, *, at_once: bool = False) -> None:
        """Calibrate when photographs have arrived, or ``at_once``, in place of what is being calibrated now."""
        desk = self.room.desk(session_id)
        desk.wanted = True
        desk.tell("pending")
        if at_once:
            desk.last_look = 0.0
            if desk.solve_job is not None:
                desk.solve_job.cancel()
        if desk.solver is None or desk.solver.done():
            desk.solver = asyncio.create_task(self._solve_while_wanted(desk))

    async def straight(self, session_id: str, photograph_id: str) -> Path:
        """The straight picture of a photograph by the newest result."""
        photograph, desk = self.room.photograph(session_id, photograph_id), self.room.desk(session_id)
        solve = desk.preview_solve or self.room.session(session_id).solve
        if solve is None:
            raise NotThere("there is no camera yet; add photographs of the board")
        folder = self.room.store.path(session_id, solve)
        target = folder / f"{photograph.id}.jpg"
        original = self.room.original(session_id, photograph.id)
        await self.room.crew.run(solving.straighten, original, folder / solving.MAP, target, self.room.limits.pixels)
        return target

    def camera(self, session_id: str) -> Path:
        """The camera file of the session's result; raises NotThere."""
        session = self.room.session(session_id)
        if session.solve is None:
            raise NotThere("there is no camera yet; add photographs of the board")
        return self.room.store.path(session_id, session.solve, solving.CAMERA)

    async def report(self, session_id: str) -> Path:
        """The report of the session's result; raises NotThere, and InputError where it is stopped."""
        camera, session, desk = self.camera(session_id), self.room.session(session_id), self.room.desk(session_id)
        path = camera.with_name("report.html")
        if path.is_file():
            return path
        if desk.report_job is None or desk.report_job.done():
            photographs = {p.name: self.room.original(session_id, p.id) for p in session.photographs}
            desk.act("Writing the report")
            desk.report_job = asyncio.create_task(self.room.crew.run(downloads.report, path, camera, photographs))
        await asyncio.wait({job := desk.report_job})
        desk.act(None)
        if job.cancelled():
            raise InputError("the report was stopped before it was written")
        job.result()
        return path

    # --- inside ---

    async def _solve_while_wanted(self, desk: Desk) -> None:
        while desk.wanted:
            while not desk.quiet() and not self._worth_a_first_look(desk):
                await asyncio.sleep(POLL)
            desk.wanted = False
            await self._solve_once(desk, only_first=not desk.quiet())

    def _worth_a_first_look(self, desk: Desk) -> bool:
        session = self.room.session(desk.session_id)
        return session.result is None and desk.preview is None and len(session.usable) >= ENOUGH_FOR_A_LOOK

    async def _solve_once(self, desk: Desk, *, only_first: bool) -> None:
        """One calibration, to its end, its failure, or until somebody wants another in its place."""
        session = self.room.session(desk.session_id)
        corners = session.corner_set()
        if corners is None or len(corners.views) < solving.FEWEST_BOARDS:
            desk.problem = None
            desk.tell("result", **result_event(session, desk))
            return
        solve = f"solve-{new_id()}"
        question = solving.Question(
            corners,
            {p.name: p.id for p in session.usable},
            session.square_mm,
            session.mirrored,
            (desk.preview or session.result or {}).get("trend"),
            only_first,
            self.room.store.path(session.id, solve),
        )
        desk.act(f"Calibrating with {len(corners.views)} photographs")
        heard = partial(self._heard_of_solve, desk, solve)
        desk.solve_job = asyncio.create_task(self.room.crew.run(solving.solve, question, heard=heard))
        try:
            await asyncio.wait({desk.solve_job})
            desk.wanted = desk.wanted or (only_first and not desk.solve_job.cancelled())
        finally:
            self._end_of_solve(desk, desk.solve_job, keep_preview=desk.wanted)

    def _heard_of_solve(self, desk: Desk, solve: str, result: Event) -> None:
        session = self.room.session(desk.session_id)
        desk.problem, desk.preview, desk.preview_solve = None, result, solve
        if (step := STEPS.get(result["stage"])) is not None:
            desk.act(step.format(len(result["photographs"])))
        if result["stage"] == "evaluated":
            desk.preview, desk.preview_solve = None, None
            self.room.store.put(replace(session, result=result, solve=solve))
        desk.tell("result", **result_event(self.room.session(session.id), desk))

    def _end_of_solve(self, desk: Desk, job: asyncio.Task[Any], *, keep_preview: bool) -> None:
        """After a calibration, however it ended: say why it failed, and forget what is no result."""
        job.cancel()
        session = self.room.store.get(desk.session_id)
        if session is None:
            return
        error = job.exception() if job.done() and not job.cancelled() else None
        if error is not None:
            desk.problem = str(error)
        if not keep_preview:
            desk.preview, desk.preview_solve = None, None
        desk.solve_job = None
        for folder in self.room.store.path(session.id).glob("solve-*"):
            if folder.name not in (session.solve, desk.preview_solve):
                self.room.store.remove(session.id, folder.name)
        desk.act(None)
        desk.tell("result", **result_event(session, desk))
