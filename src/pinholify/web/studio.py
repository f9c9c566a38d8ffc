"""What the app does: takes photographs, looks at them, calibrates, and keeps open pages informed.

Everything here runs on the event loop's one thread and only changes plain data; what takes time goes to the
:class:`~pinholify.web.work.Crew`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pinholify.board import Board
from pinholify.errors import InputError, PinholifyError
from pinholify.web import guidance, looking, solving, video
from pinholify.web.desk import Desk, Event, photograph_event, postures_of, result_event, session_event
from pinholify.web.limits import Limits, TooMuch
from pinholify.web.sessions import Photograph, Session, Store, new_id
from pinholify.web.work import Crew

ENOUGH_FOR_A_LOOK = 6  # boards from which on a first result is made while more photographs arrive
POLL = 0.05  # seconds


class NotThere(InputError):
    """What was asked for does not exist, or no longer."""


class Studio:
    """All sessions in ``folder``, within ``limits``, and the processes that work for them."""

    def __init__(self, folder: Path, limits: Limits, workers: int | None = None) -> None:
        """Reads what there is; ``workers`` processes at most, as many as suit this computer by default."""
        self.limits = limits
        self.store = Store(folder)
        self.crew = Crew(workers)
        self._desks: dict[str, Desk] = {}

    async def close(self) -> None:
        """End all work."""
        tasks = [task for desk in self._desks.values() for task in desk.tasks()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self.crew.close()

    # --- sessions ---

    def session(self, session_id: str) -> Session:
        """The session of that id; raises NotThere."""
        session = self.store.get(session_id)
        if session is None:
            raise NotThere("there is no such session; it may have been deleted")
        return session

    def desk(self, session_id: str) -> Desk:
        """The desk of a session."""
        return self._desks.setdefault(session_id, Desk(session_id))

    def create(self, board: Board | None, square_mm: float | None) -> Session:
        """A new session; raises TooMuch where there are too many."""
        if len(self.store.ids()) >= self.limits.sessions:
            raise TooMuch(f"there are {self.limits.sessions} sessions already; delete one you no longer need")
        return self.store.create(board, square_mm)

    def delete(self, session_id: str) -> None:
        """End a session's work and remove all of it."""
        self.session(session_id)
        desk = self._desks.pop(session_id, None)
        for task in desk.tasks() if desk else []:
            task.cancel()
        self.store.remove(session_id)
        if desk:
            desk.tell("gone")

    def change(self, session_id: str, **changes: Any) -> None:
        """Change name, ``board``, ``square_mm`` or ``mirrored``; what depends on it is done again."""
        before = self.session(session_id)
        session = replace(before, **changes)
        self._put(session)
        if session.board != before.board or session.mirrored != before.mirrored:
            self._look_again([p.id for p in session.photographs], session_id)
        elif session.square_mm != before.square_mm:
            self.want_solve(session_id, at_once=True)

    # --- photographs ---

    def check_room(self, session_id: str) -> None:
        """Raise TooMuch where the session holds all it may."""
        photographs = self.session(session_id).photographs
        if len(photographs) >= self.limits.photographs:
            raise TooMuch(f"the session holds {len(photographs)} photographs already; remove some, or start another")
        if sum(p.bytes for p in photographs) >= self.limits.session_bytes:
            raise TooMuch("the session's photographs fill all the room it has; remove some, or start another")

    async def add_photograph(self, session_id: str, arrived: Path, name: str) -> Photograph:
        """Look at the picture that ``arrived`` and keep it; raises ImageError, and keeps nothing, where it is none."""
        pages = self.store.arriving(session_id)
        with self._arriving(session_id):
            try:
                seen = await self._look(session_id, arrived, name, pages)
                return self._keep(session_id, seen, name, arrived, pages)
            finally:
                self._forget(arrived, pages)

    async def add_frame(self, session_id: str, arrived: Path) -> Event:
        """Look at a frame of the live camera, keep it where it is worth it, and say what to do next."""
        desk, name = self.desk(session_id), "frame.jpg"
        pages = self.store.arriving(session_id)
        try:
            seen = await self._look(session_id, arrived, name, None)
            session = self.session(session_id)
            previous, desk.previous = desk.previous, seen.corners
            choice = self._choice(session, seen, previous)
            photograph = None
            if choice.keep:
                await self.crew.run(looking.show, arrived, name, self.limits.pixels, pages)
                photograph = self._keep(session_id, seen, name, arrived, pages)
        finally:
            self._forget(arrived, pages)
        return {
            "uv": seen.corners.uv.round(1).tolist(),
            "ids": seen.corners.ids.tolist(),
            "size": seen.size,
            "hint": choice.hint,
            "kept": None if photograph is None else photograph.id,
        }

    def include(self, session_id: str, photograph_id: str, included: bool) -> None:
        """Let a photograph count, or not."""
        photograph = replace(self._photograph(session_id, photograph_id), included=included)
        self._put_photograph(session_id, photograph)
        self.want_solve(session_id, at_once=True)

    def remove(self, session_id: str, photograph_id: str) -> None:
        """Remove a photograph for good."""
        photograph = self._photograph(session_id, photograph_id)
        self._put(self.session(session_id).without_photograph(photograph_id))
        self.store.remove(session_id, photograph_id)
        self.desk(session_id).tell("removed", id=photograph_id)
        if photograph.corners.found and photograph.included:
            self.want_solve(session_id, at_once=True)

    def add_video(self, session_id: str, arrived: Path, name: str) -> None:
        """Start to choose frames of the video that ``arrived``; raises TooMuch while another is under way."""
        desk = self.desk(session_id)
        if desk.other_job is not None and not desk.other_job.done():
            self._forget(arrived)
            raise TooMuch("another video is being looked through; wait for it, or stop it first")
        desk.other_job = asyncio.create_task(self._choose_frames(session_id, arrived, name))

    # --- calibration ---

    def want_solve(self, session_id: str, *, at_once: bool = False) -> None:
        """Calibrate when photographs have arrived, or ``at_once``, in place of what is being calibrated now."""
        desk = self.desk(session_id)
        desk.wanted = True
        if at_once:
            desk.last_look = 0.0
            if desk.solve_job is not None:
                desk.solve_job.cancel()
        if desk.solver is None or desk.solver.done():
            desk.solver = asyncio.create_task(self._solve_while_wanted(desk))

    def cancel(self, session_id: str) -> None:
        """End the session's long work; what was there before stays."""
        desk = self.desk(session_id)
        desk.wanted = False
        for task in desk.tasks():
            task.cancel()

    async def straight(self, session_id: str, photograph_id: str) -> Path:
        """The straight picture of a photograph by the newest result."""
        photograph, desk = self._photograph(session_id, photograph_id), self.desk(session_id)
        solve = desk.preview_solve or self.session(session_id).solve
        if solve is None:
            raise NotThere("there is no camera yet; add photographs of the board")
        folder = self.store.path(session_id, solve)
        target = folder / f"{photograph.id}.jpg"
        arguments = (self._original(session_id, photograph.id), folder / solving.MAP, target, self.limits.pixels)
        await self.crew.run(solving.straighten, *arguments)
        return target

    def camera(self, session_id: str) -> Path:
        """The camera file of the session's result; raises NotThere."""
        session = self.session(session_id)
        if session.solve is None:
            raise NotThere("there is no camera yet; add photographs of the board")
        return self.store.path(session_id, session.solve, solving.CAMERA)

    # --- inside: photographs ---

    async def _look(self, session_id: str, arrived: Path, name: str, pages: Path | None) -> looking.Look:
        """What a picture shows of the session's board, or of the one that became the session's meanwhile."""
        while True:
            session = self.session(session_id)
            question = (arrived, name, session.board, session.mirrored, self.limits.pixels, pages)
            seen: looking.Look = await self.crew.run(looking.look, *question)
            now = self.session(session_id)
            if now.board is None and seen.board is not None:
                now = replace(now, board=seen.board)
                self._put(now)
                self._look_again([p.id for p in now.photographs if not p.corners.found], session_id)
            if now.board == seen.board and now.mirrored == session.mirrored:
                return seen

    def _keep(self, session_id: str, seen: looking.Look, name: str, arrived: Path, pages: Path) -> Photograph:
        session = self.session(session_id)
        corners = replace(seen.corners, name=session.free_name(name))
        bytes_ = arrived.stat().st_size
        photograph = Photograph(new_id(), seen.size, bytes_, corners, seen.blur_px, seen.suggestion)
        arrived.replace(pages / "original")
        pages.replace(self.store.path(session_id, photograph.id))
        self._put_photograph(session_id, photograph)
        if corners.found:
            self.want_solve(session_id)
        return photograph

    def _choice(self, session: Session, seen: looking.Look, previous: Any) -> guidance.Choice:
        if seen.board is None or seen.blur_px is None:
            wrong = f"This is a board of {seen.suggestion}" if seen.suggestion else "No board in sight"
            return guidance.Choice(False, wrong)
        if len(session.photographs) >= self.limits.photographs:
            return guidance.Choice(False, "The session is full")
        if previous is None:
            return guidance.Choice(False, "Hold the board still")
        kept = postures_of(session)
        return guidance.choose(seen.corners, seen.board, seen.size, seen.blur_px, kept, previous)

    async def _choose_frames(self, session_id: str, arrived: Path, name: str) -> None:
        desk, session, folder = self.desk(session_id), self.session(session_id), self.store.arriving(session_id)
        desk.act("Looking through the video", 0.0)
        limits = (self.limits.pixels, self.limits.video_frames)
        question = (arrived, name, session.board, session.mirrored, postures_of(session), limits, folder)
        try:
            await self.crew.run(video.frames, *question, heard=partial(self._heard_of_video, session_id))
        except PinholifyError as error:
            desk.tell("notice", text=str(error))
        finally:
            desk.act(None)
            self._forget(arrived, folder)

    def _heard_of_video(self, session_id: str, said: object) -> None:
        desk = self.desk(session_id)
        if isinstance(said, video.Done):
            desk.act("Looking through the video", said.share)
        elif isinstance(said, video.Frame):
            if self.session(session_id).board is None:
                self._put(replace(self.session(session_id), board=said.look.board))
            self._keep(session_id, said.look, said.look.corners.name, said.folder / "original.png", said.folder)

    def _look_again(self, photograph_ids: list[str], session_id: str) -> None:
        desk = self.desk(session_id)
        if desk.other_job is not None:
            desk.other_job.cancel()
        if photograph_ids:
            desk.other_job = asyncio.create_task(self._look_at_all(session_id, photograph_ids))

    async def _look_at_all(self, session_id: str, photograph_ids: list[str]) -> None:
        desk, done = self.desk(session_id), 0
        desk.act("Looking for the board", 0.0)

        async def one(photograph_id: str) -> None:
            nonlocal done
            await self._look_once_more(session_id, photograph_id)
            done += 1
            desk.act("Looking for the board", done / len(photograph_ids))

        try:
            with self._arriving(session_id):
                await asyncio.gather(*(one(photograph_id) for photograph_id in photograph_ids))
        finally:
            desk.act(None)
        self.want_solve(session_id, at_once=True)

    async def _look_once_more(self, session_id: str, photograph_id: str) -> None:
        session = self.session(session_id)
        before = session.photograph(photograph_id)
        if before is None:
            return
        question = (session.board, session.mirrored, self.limits.pixels, None)
        seen = await self.crew.run(looking.look, self._original(session_id, photograph_id), before.name, *question)
        now = self.session(session_id).photograph(photograph_id)
        if now is not None:
            changes = {"corners": seen.corners, "blur_px": seen.blur_px, "suggestion": seen.suggestion}
            self._put_photograph(session_id, replace(now, **changes))

    # --- inside: calibration ---

    async def _solve_while_wanted(self, desk: Desk) -> None:
        while desk.wanted:
            while not desk.quiet() and not self._worth_a_first_look(desk):
                await asyncio.sleep(POLL)
            desk.wanted = False
            await self._solve_once(desk, only_first=not desk.quiet())

    def _worth_a_first_look(self, desk: Desk) -> bool:
        session = self.session(desk.session_id)
        return session.result is None and desk.preview is None and len(session.usable) >= ENOUGH_FOR_A_LOOK

    async def _solve_once(self, desk: Desk, *, only_first: bool) -> None:
        """One calibration, to its end, its failure, or until somebody wants another in its place."""
        session = self.session(desk.session_id)
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
            self.store.path(session.id, solve),
        )
        desk.act(f"Calibrating with {len(corners.views)} photographs")
        heard = partial(self._heard_of_solve, desk, solve)
        desk.solve_job = asyncio.create_task(self.crew.run(solving.solve, question, heard=heard))
        try:
            await asyncio.wait({desk.solve_job})
            desk.wanted = desk.wanted or (only_first and not desk.solve_job.cancelled())
        finally:
            self._end_of_solve(desk, desk.solve_job, keep_preview=desk.wanted)

    def _heard_of_solve(self, desk: Desk, solve: str, result: Event) -> None:
        session = self.session(desk.session_id)
        desk.problem, desk.preview, desk.preview_solve = None, result, solve
        if result["stage"] == "evaluated":
            desk.preview, desk.preview_solve = None, None
            self.store.put(replace(session, result=result, solve=solve))
        desk.tell("result", **result_event(self.session(session.id), desk))

    def _end_of_solve(self, desk: Desk, job: asyncio.Task[Any], *, keep_preview: bool) -> None:
        """After a calibration, however it ended: say why it failed, and forget what is no result."""
        job.cancel()
        session = self.store.get(desk.session_id)
        if session is None:
            return
        error = job.exception() if job.done() and not job.cancelled() else None
        if error is not None:
            desk.problem = str(error)
        if not keep_preview:
            desk.preview, desk.preview_solve = None, None
        desk.solve_job = None
        for folder in self.store.path(session.id).glob("solve-*"):
            if folder.name not in (session.solve, desk.preview_solve):
                self.store.remove(session.id, folder.name)
        desk.act(None)
        desk.tell("result", **result_event(session, desk))

    # --- inside: keeping and telling ---

    def _photograph(self, session_id: str, photograph_id: str) -> Photograph:
        photograph = self.session(session_id).photograph(photograph_id)
        if photograph is None:
            raise NotThere("there is no such photograph; it may have been removed")
        return photograph

    def _original(self, session_id: str, photograph_id: str) -> Path:
        return self.store.path(session_id, photograph_id, "original")

    def _put(self, session: Session) -> None:
        self.store.put(session)
        desk = self.desk(session.id)
        desk.tell("session", session=session_event(session))

    def _put_photograph(self, session_id: str, photograph: Photograph) -> None:
        session = self.session(session_id).with_photograph(photograph)
        self.store.put_photograph(session, photograph)
        self.desk(session_id).tell("photograph", photograph=photograph_event(photograph))
        self._put(session)

    @contextmanager
    def _arriving(self, session_id: str) -> Any:
        desk = self.desk(session_id)
        desk.looking += 1
        try:
            yield
        finally:
            desk.looking -= 1
            desk.last_look = asyncio.get_running_loop().time()

    def _forget(self, *paths: Path) -> None:
        for path in paths:
            self.store.remove(path.parent.name, path.name)


def summary(session: Session) -> Event:
    """A session as it stands in the list of all."""
    result = session.result or {}
    first = next((p.id for p in session.photographs if p.corners.found), None)
    return {
        "id": session.id,
        "name": session.name,
        "created": session.created,
        "board": session.board.spec if session.board else None,
        "photographs": len(session.photographs),
        "f_px": result.get("f_px"),
        "level": result.get("level"),
        "thumb": first,
    }


def summaries(sessions: Iterable[Session]) -> list[Event]:
    """All sessions, for the list."""
    return [summary(session) for session in sessions]
