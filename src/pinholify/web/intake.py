"""Photographs coming in, one way or another: files, frames of a live camera, frames of a video."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from pinholify.corners import Corners
from pinholify.errors import PinholifyError
from pinholify.web import guidance, looking, video
from pinholify.web.calibrator import Calibrator
from pinholify.web.desk import Event, postures_of
from pinholify.web.limits import TooMuch
from pinholify.web.sessions import Photograph, Session, new_id
from pinholify.web.workroom import Workroom


class Intake:
    """Looks at what comes in, keeps what is worth it, and has the ``calibrator`` know."""

    def __init__(self, room: Workroom, calibrator: Calibrator) -> None:
        """Works in ``room``."""
        self.room = room
        self.calibrator = calibrator

    def check_room(self, session_id: str) -> None:
        """Raise TooMuch where the session holds all it may."""
        photographs = self.room.session(session_id).photographs
        if len(photographs) >= self.room.limits.photographs:
            raise TooMuch(f"the session holds {len(photographs)} photographs already; remove some, or start another")
        if sum(p.bytes for p in photographs) >= self.room.limits.session_bytes:
            raise TooMuch("the session's photographs fill all the room it has; remove some, or start another")

    async def add_photograph(self, session_id: str, arrived: Path, name: str) -> Photograph:
        """Look at the picture that ``arrived`` and keep it; raises ImageError, and keeps nothing, where it is none."""
        pages = self.room.store.arriving(session_id)
        with self._arrivals(session_id):
            try:
                seen = await self._look(session_id, arrived, name, pages)
                return self._keep(session_id, seen, name, arrived, pages)
            finally:
                self.room.forget(arrived, pages)

    async def add_frame(self, session_id: str, arrived: Path) -> Event:
        """Look at a frame of the live camera, keep it where it is worth it, and say what to do next."""
        desk, pages = self.room.desk(session_id), self.room.store.arriving(session_id)
        name = f"frame-{len(self.room.session(session_id).photographs) + 1}.jpg"
        try:
            seen = await self._look(session_id, arrived, name, None)
            session = self.room.session(session_id)
            previous, desk.previous = desk.previous, seen.corners
            choice = self._choice(session, seen, previous)
            photograph = None
            if choice.keep:
                await self.room.crew.run(looking.show, arrived, name, self.room.limits.pixels, pages)
                photograph = self._keep(session_id, seen, name, arrived, pages)
        finally:
            self.room.forget(arrived, pages)
        return {
            "uv": seen.corners.uv.round(1).tolist(),
            "ids": seen.corners.ids.tolist(),
            "size": seen.size,
            "hint": choice.hint,
            "kept": None if photograph is None else photograph.id,
        }

    def include(self, session_id: str, photograph_id: str, included: bool) -> None:
        """Let a photograph count, or not."""
        photograph = replace(self.room.photograph(session_id, photograph_id), included=included)
        self.room.put_photograph(session_id, photograph)
        self.calibrator.want(session_id, at_once=True)

    def remove(self, session_id: str, photograph_id: str) -> None:
        """Remove a photograph for good."""
        photograph = self.room.photograph(session_id, photograph_id)
        self.room.put(self.room.session(session_id).without_photograph(photograph_id))
        self.room.store.remove(session_id, photograph_id)
        self.room.desk(session_id).tell("removed", id=photograph_id)
        if photograph.corners.found and photograph.included:
            self.calibrator.want(session_id, at_once=True)

    def add_video(self, session_id: str, arrived: Path, name: str) -> None:
        """Start to choose frames of the video that ``arrived``; raises TooMuch while another is under way."""
        desk = self.room.desk(session_id)
        if desk.video_job is not None and not desk.video_job.done():
            self.room.forget(arrived)
            raise TooMuch("another video is being looked through; wait for it, or stop it first")
        desk.video_job = asyncio.create_task(self._choose_frames(session_id, arrived, name))

    def look_again(self, session_id: str, photograph_ids: list[str]) -> None:
        """Start to look at photographs once more, for another board."""
        desk = self.room.desk(session_id)
        if desk.look_job is not None:
            desk.look_job.cancel()
        if photograph_ids:
            desk.look_job = asyncio.create_task(self._look_at_all(session_id, photograph_ids))

    # --- inside ---

    async def _look(self, session_id: str, arrived: Path, name: str, pages: Path | None) -> looking.Look:
        """What a picture shows of the session's board, or of the one that became the session's meanwhile."""
        while True:
            session = self.room.session(session_id)
            question = (arrived, name, session.board, session.mirrored, self.room.limits.pixels, pages)
            seen: looking.Look = await self.room.crew.run(looking.look, *question)
            now = self.room.session(session_id)
            if now.board is None and seen.board is not None:
                now = replace(now, board=seen.board)
                self.room.put(now)
                self.look_again(session_id, [p.id for p in now.photographs if not p.corners.found])
            if now.board == seen.board and now.mirrored == session.mirrored:
                return seen

    def _keep(self, session_id: str, seen: looking.Look, name: str, arrived: Path, pages: Path) -> Photograph:
        session = self.room.session(session_id)
        corners = replace(seen.corners, name=session.free_name(name))
        bytes_ = arrived.stat().st_size
        photograph = Photograph(new_id(), seen.size, bytes_, corners, seen.blur_px, seen.suggestion)
        arrived.replace(pages / "original")
        pages.replace(self.room.store.path(session_id, photograph.id))
        self.room.put_photograph(session_id, photograph)
        if corners.found:
            self.calibrator.want(session_id)
        return photograph

    def _choice(self, session: Session, seen: looking.Look, previous: Corners | None) -> guidance.Choice:
        if seen.board is None or seen.blur_px is None:
            wrong = f"This is a board of {seen.suggestion}" if seen.suggestion else "No board in sight"
            return guidance.Choice(False, wrong)
        if len(session.photographs) >= self.room.limits.photographs:
            return guidance.Choice(False, "The session is full")
        if previous is None:
            return guidance.Choice(False, "Hold the board still")
        kept = postures_of(session)
        return guidance.choose(seen.corners, seen.board, seen.size, seen.blur_px, kept, previous)

    async def _choose_frames(self, session_id: str, arrived: Path, name: str) -> None:
        desk, session = self.room.desk(session_id), self.room.session(session_id)
        folder = self.room.store.arriving(session_id)
        desk.act("Looking through the video", 0.0)
        limits = (self.room.limits.pixels, self.room.limits.video_frames)
        question = (arrived, name, session.board, session.mirrored, postures_of(session), limits, folder)
        try:
            with self._arrivals(session_id):
                await self.room.crew.run(video.frames, *question, heard=partial(self._heard_of_video, session_id))
        except PinholifyError as error:
            desk.tell("notice", text=str(error))
        finally:
            desk.act(None)
            self.room.forget(arrived, folder)

    def _heard_of_video(self, session_id: str, said: object) -> None:
        desk = self.room.desk(session_id)
        if isinstance(said, video.Done):
            desk.act("Looking through the video", said.share)
        elif isinstance(said, video.Frame):
            if self.room.session(session_id).board is None:
                self.room.put(replace(self.room.session(session_id), board=said.look.board))
            self._keep(session_id, said.look, said.look.corners.name, said.folder / "original.png", said.folder)

    async def _look_at_all(self, session_id: str, photograph_ids: list[str]) -> None:
        desk, done = self.room.desk(session_id), 0
        desk.act("Looking for the board", 0.0)

        async def one(photograph_id: str) -> None:
            nonlocal done
            await self._look_once_more(session_id, photograph_id)
            done += 1
            desk.act("Looking for the board", done / len(photograph_ids))

        try:
            with self._arrivals(session_id):
                await asyncio.gather(*(one(photograph_id) for photograph_id in photograph_ids))
        finally:
            desk.act(None)
        self.calibrator.want(session_id, at_once=True)

    async def _look_once_more(self, session_id: str, photograph_id: str) -> None:
        session = self.room.session(session_id)
        before = session.photograph(photograph_id)
        if before is None:
            return
        original = self.room.original(session_id, photograph_id)
        question = (original, before.name, session.board, session.mirrored, self.room.limits.pixels, None)
        seen = await self.room.crew.run(looking.look, *question)
        now = self.room.session(session_id).photograph(photograph_id)
        if now is not None:
            changes = {"corners": seen.corners, "blur_px": seen.blur_px, "suggestion": seen.suggestion}
            self.room.put_photograph(session_id, replace(now, **changes))

    @contextmanager
    def _arrivals(self, session_id: str) -> Iterator[None]:
        desk = self.room.desk(session_id)
        desk.looking += 1
        try:
            yield
        finally:
            desk.looking -= 1
            desk.last_look = asyncio.get_running_loop().time()
