"""Running the calibrations of sessions, and storing and serving their results."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pinholify.calibration.methods import FEWEST_BOARDS
from pinholify.errors import InputError
from pinholify.web import downloads, solving
from pinholify.web.context import AppContext, NotFound
from pinholify.web.session_state import Event, SessionState, result_event
from pinholify.web.sessions import new_id

ENOUGH_FOR_PREVIEW = 6  # boards from which a preview is made while more photographs arrive
POLL = 0.05  # seconds
STEPS = {
    "first": "Preview of {} photographs ready; choosing the best model",
    "camera": "Camera of {} photographs ready; computing its held-out error",
}
"""What is done once a stage of a calibration is finished."""


class Calibrator:
    """Calibrates the sessions of ``context``, one calibration at a time in each."""

    def __init__(self, context: AppContext) -> None:
        """Starts no calibration yet."""
        self.context = context

    def request(self, session_id: str, *, at_once: bool = False) -> None:
        """Calibrate when no more photographs are arriving, or ``at_once``, cancelling a running calibration."""
        state = self.context.state(session_id)
        state.requested = True
        state.publish("pending")
        if at_once:
            state.last_arrival = 0.0
            if state.solve_job is not None:
                state.solve_job.cancel()
        if state.solver is None or state.solver.done():
            state.solver = asyncio.create_task(self._solve_while_requested(state))

    async def straight(self, session_id: str, photograph_id: str) -> Path:
        """The file of a photograph straightened by the newest result; raises NotFound."""
        photograph, state = self.context.photograph(session_id, photograph_id), self.context.state(session_id)
        solve = state.preview_solve or self.context.session(session_id).solve
        if solve is None:
            raise NotFound("there is no camera yet; add photographs of the board")
        folder = self.context.store.path(session_id, solve)
        target = folder / f"{photograph.id}.jpg"
        original, pixels = self.context.original(session_id, photograph.id), self.context.limits.pixels
        await self.context.pool.run(solving.straighten, original, folder / solving.MAP, target, pixels)
        return target

    def camera(self, session_id: str) -> Path:
        """The camera file of the session's result; raises NotFound."""
        session = self.context.session(session_id)
        if session.solve is None:
            raise NotFound("there is no camera yet; add photographs of the board")
        return self.context.store.path(session_id, session.solve, solving.CAMERA)

    async def report(self, session_id: str) -> Path:
        """The report file of the session's result; raises NotFound, and InputError if it is cancelled."""
        camera, session = self.camera(session_id), self.context.session(session_id)
        state = self.context.state(session_id)
        path = camera.with_name("report.html")
        if path.is_file():
            return path
        if state.report_job is None or state.report_job.done():
            photographs = {p.name: self.context.original(session_id, p.id) for p in session.photographs}
            state.set_activity("Writing the report")
            state.report_job = asyncio.create_task(self.context.pool.run(downloads.report, path, camera, photographs))
        await asyncio.wait({job := state.report_job})
        state.set_activity(None)
        if job.cancelled():
            raise InputError("the report was cancelled")
        job.result()
        return path

    # --- private ---

    async def _solve_while_requested(self, state: SessionState) -> None:
        while state.requested:
            while not state.idle() and not self._preview_due(state):
                await asyncio.sleep(POLL)
            state.requested = False
            await self._solve_once(state, preview_only=not state.idle())

    def _preview_due(self, state: SessionState) -> bool:
        session = self.context.session(state.session_id)
        return session.result is None and state.preview is None and len(session.usable) >= ENOUGH_FOR_PREVIEW

    async def _solve_once(self, state: SessionState, *, preview_only: bool) -> None:
        """One calibration, until it ends, fails or is cancelled."""
        session = self.context.session(state.session_id)
        corners = session.corner_set()
        if corners is None or len(corners.views) < FEWEST_BOARDS:
            state.problem = None
            state.publish("result", **result_event(session, state))
            return
        solve = f"solve-{new_id()}"
        request = solving.SolveRequest(
            corners,
            {p.name: p.id for p in session.usable},
            session.square_mm,
            session.mirrored,
            (state.preview or session.result or {}).get("trend"),
            preview_only,
            self.context.store.path(session.id, solve),
        )
        state.set_activity(f"Calibrating with {len(corners.views)} photographs")
        on_result = partial(self._on_result, state, solve)
        state.solve_job = asyncio.create_task(self.context.pool.run(solving.solve, request, on_message=on_result))
        try:
            await asyncio.wait({state.solve_job})
            state.requested = state.requested or (preview_only and not state.solve_job.cancelled())
        finally:
            self._end_of_solve(state, state.solve_job, keep_preview=state.requested)

    def _on_result(self, state: SessionState, solve: str, result: Event) -> None:
        session = self.context.session(state.session_id)
        state.problem, state.preview, state.preview_solve = None, result, solve
        if (step := STEPS.get(result["stage"])) is not None:
            state.set_activity(step.format(len(result["photographs"])))
        if result["stage"] == "evaluated":
            state.preview, state.preview_solve = None, None
            self.context.store.put(replace(session, result=result, solve=solve))
        state.publish("result", **result_event(self.context.session(session.id), state))

    def _end_of_solve(self, state: SessionState, job: asyncio.Task[Any], *, keep_preview: bool) -> None:
        """After a calibration, however it ended: publish why it failed, and remove the files of superseded results."""
        job.cancel()
        session = self.context.store.get(state.session_id)
        if session is None:
            return
        error = job.exception() if job.done() and not job.cancelled() else None
        if error is not None:
            state.problem = str(error)
        if not keep_preview:
            state.preview, state.preview_solve = None, None
        state.solve_job = None
        for folder in self.context.store.path(session.id).glob("solve-*"):
            if folder.name not in (session.solve, state.preview_solve):
                self.context.store.remove(session.id, folder.name)
        state.set_activity(None)
        state.publish("result", **result_event(session, state))
