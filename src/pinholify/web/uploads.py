"""Uploads: photographs, frames of a live camera, and videos, of which frames are chosen."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from pinholify.corners import Corners
from pinholify.errors import PinholifyError
from pinholify.web import guidance, video
from pinholify.web.calibrator import Calibrator
from pinholify.web.context import AppContext
from pinholify.web.inspection import Inspection, inspect_file, write_file_previews
from pinholify.web.limits import LimitExceeded
from pinholify.web.session_state import Event, postures_of
from pinholify.web.sessions import Photograph, Session, new_id


class Uploads:
    """Inspects uploads, adds them to their session, and requests calibrations from the ``calibrator``."""

    def __init__(self, context: AppContext, calibrator: Calibrator) -> None:
        """Starts no work yet."""
        self.context = context
        self.calibrator = calibrator

    def check_limits(self, session_id: str) -> None:
        """Raise LimitExceeded if the session cannot take more photographs."""
        photographs = self.context.session(session_id).photographs
        if len(photographs) >= self.context.limits.photographs:
            raise LimitExceeded(f"the session already has {len(photographs)} photographs; remove some or start another")
        if sum(p.bytes for p in photographs) >= self.context.limits.session_bytes:
            raise LimitExceeded("the session's photographs fill all its space; remove some or start another")

    async def add_photograph(self, session_id: str, arrived: Path, name: str) -> Photograph:
        """Inspect the uploaded file ``arrived`` and add it; raises ImageError if it is not a picture."""
        previews = self.context.store.arriving(session_id)
        with self._inspecting(session_id):
            try:
                seen = await self._inspect(session_id, arrived, name, previews)
                return self._keep(session_id, seen, name, arrived, previews)
            finally:
                self.context.discard(arrived, previews)

    async def add_frame(self, session_id: str, arrived: Path) -> Event:
        """Inspect a frame of the live camera, add it if it is useful, and return a hint on what to do next."""
        state, previews = self.context.state(session_id), self.context.store.arriving(session_id)
        name = f"frame-{len(self.context.session(session_id).photographs) + 1}.jpg"
        try:
            seen = await self._inspect(session_id, arrived, name, None)
            session = self.context.session(session_id)
            previous, state.previous = state.previous, seen.corners
            choice = self._choice(session, seen, previous)
            photograph = None
            if choice.keep:
                await self.context.pool.run(write_file_previews, arrived, name, self.context.limits.pixels, previews)
                photograph = self._keep(session_id, seen, name, arrived, previews)
        finally:
            self.context.discard(arrived, previews)
        return {
            "uv": seen.corners.uv.round(1).tolist(),
            "ids": seen.corners.ids.tolist(),
            "size": seen.size,
            "hint": choice.hint,
            "kept": None if photograph is None else photograph.id,
        }

    def include(self, session_id: str, photograph_id: str, included: bool) -> None:
        """Include or exclude a photograph."""
        photograph = replace(self.context.photograph(session_id, photograph_id), included=included)
        self.context.put_photograph(session_id, photograph)
        self.calibrator.request(session_id, at_once=True)

    def remove(self, session_id: str, photograph_id: str) -> None:
        """Delete a photograph and its files."""
        photograph = self.context.photograph(session_id, photograph_id)
        self.context.put(self.context.session(session_id).without_photograph(photograph_id))
        self.context.store.remove(session_id, photograph_id)
        self.context.state(session_id).publish("removed", id=photograph_id)
        if photograph.corners.found and photograph.included:
            self.calibrator.request(session_id, at_once=True)

    def add_video(self, session_id: str, arrived: Path, name: str) -> None:
        """Start choosing frames of the uploaded video ``arrived``; raises LimitExceeded while another is searched."""
        state = self.context.state(session_id)
        if state.video_job is not None and not state.video_job.done():
            self.context.discard(arrived)
            raise LimitExceeded("another video is being searched; wait for it or stop it first")
        state.video_job = asyncio.create_task(self._choose_frames(session_id, arrived, name))

    def inspect_again(self, session_id: str, photograph_ids: list[str]) -> None:
        """Start inspecting photographs again, for another board."""
        state = self.context.state(session_id)
        if state.inspection_job is not None:
            state.inspection_job.cancel()
        if photograph_ids:
            state.inspection_job = asyncio.create_task(self._inspect_all(session_id, photograph_ids))

    # --- private ---

    async def _inspect(self, session_id: str, arrived: Path, name: str, previews: Path | None) -> Inspection:
        """Inspect a picture for the session's board, again if that has changed meanwhile."""
        while True:
            session = self.context.session(session_id)
            arguments = (arrived, name, session.board, session.mirrored, self.context.limits.pixels, previews)
            seen: Inspection = await self.context.pool.run(inspect_file, *arguments)
            now = self.context.session(session_id)
            if now.board is None and seen.board is not None:
                now = replace(now, board=seen.board)
                self.context.put(now)
                self.inspect_again(session_id, [p.id for p in now.photographs if not p.corners.found])
            if now.board == seen.board and now.mirrored == session.mirrored:
                return seen

    def _keep(self, session_id: str, seen: Inspection, name: str, arrived: Path, previews: Path) -> Photograph:
        session = self.context.session(session_id)
        corners = replace(seen.corners, name=session.free_name(name))
        bytes_ = arrived.stat().st_size
        photograph = Photograph(new_id(), seen.size, bytes_, corners, seen.blur_px, seen.suggestion)
        arrived.replace(previews / "original")
        previews.replace(self.context.store.path(session_id, photograph.id))
        self.context.put_photograph(session_id, photograph)
        if corners.found:
            self.calibrator.request(session_id)
        return photograph

    def _choice(self, session: Session, seen: Inspection, previous: Corners | None) -> guidance.Choice:
        if seen.board is None or seen.blur_px is None:
            hint = f"This is a board of {seen.suggestion}" if seen.suggestion else "No board in view"
            return guidance.Choice(False, hint)
        if len(session.photographs) >= self.context.limits.photographs:
            return guidance.Choice(False, "The session is full")
        if previous is None:
            return guidance.Choice(False, "Hold the board still")
        kept = postures_of(session)
        return guidance.choose(seen.corners, seen.board, seen.size, seen.blur_px, kept, previous)

    async def _choose_frames(self, session_id: str, arrived: Path, name: str) -> None:
        state, session = self.context.state(session_id), self.context.session(session_id)
        folder = self.context.store.arriving(session_id)
        state.set_activity("Searching the video", 0.0)
        limits = (self.context.limits.pixels, self.context.limits.video_frames)
        arguments = (arrived, name, session.board, session.mirrored, postures_of(session), limits, folder)
        on_message = partial(self._on_video_message, session_id)
        try:
            with self._inspecting(session_id):
                await self.context.pool.run(video.frames, *arguments, on_message=on_message)
        except PinholifyError as error:
            state.publish("notice", text=str(error))
        finally:
            state.set_activity(None)
            self.context.discard(arrived, folder)

    def _on_video_message(self, session_id: str, message: video.Progress | video.VideoFrame) -> None:
        if isinstance(message, video.Progress):
            self.context.state(session_id).set_activity("Searching the video", message.share)
            return
        seen, session = message.inspection, self.context.session(session_id)
        if session.board is None:
            self.context.put(replace(session, board=seen.board))
        self._keep(session_id, seen, seen.corners.name, message.folder / "original.png", message.folder)

    async def _inspect_all(self, session_id: str, photograph_ids: list[str]) -> None:
        state, done = self.context.state(session_id), 0
        state.set_activity("Searching for the board", 0.0)

        async def one(photograph_id: str) -> None:
            nonlocal done
            await self._inspect_again(session_id, photograph_id)
            done += 1
            state.set_activity("Searching for the board", done / len(photograph_ids))

        try:
            with self._inspecting(session_id):
                await asyncio.gather(*(one(photograph_id) for photograph_id in photograph_ids))
        finally:
            state.set_activity(None)
        self.calibrator.request(session_id, at_once=True)

    async def _inspect_again(self, session_id: str, photograph_id: str) -> None:
        session = self.context.session(session_id)
        before = session.photograph(photograph_id)
        if before is None:
            return
        original = self.context.original(session_id, photograph_id)
        arguments = (original, before.name, session.board, session.mirrored, self.context.limits.pixels, None)
        seen = await self.context.pool.run(inspect_file, *arguments)
        now = self.context.session(session_id).photograph(photograph_id)
        if now is not None:
            changes = {"corners": seen.corners, "blur_px": seen.blur_px, "suggestion": seen.suggestion}
            self.context.put_photograph(session_id, replace(now, **changes))

    @contextmanager
    def _inspecting(self, session_id: str) -> Iterator[None]:
        state = self.context.state(session_id)
        state.inspecting += 1
        try:
            yield
        finally:
            state.inspecting -= 1
            state.last_arrival = asyncio.get_running_loop().time()
