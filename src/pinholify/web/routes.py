"""The HTTP routes of the app, which delegate to the session manager."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel, Field
from starlette.background import BackgroundTask

from pinholify import __version__
from pinholify.board import parse_board
from pinholify.errors import InputError
from pinholify.io.board_print import FORMATS as BOARD_FORMATS
from pinholify.io.board_print import PAGES
from pinholify.io.export import FORMATS
from pinholify.web import downloads
from pinholify.web.context import NotFound
from pinholify.web.manager import SessionManager, summary
from pinholify.web.process_pool import Function
from pinholify.web.security import REPORT_POLICY
from pinholify.web.session_state import Event, photograph_event, result_event, session_event
from pinholify.web.sessions import new_id

HEARTBEAT = 15.0  # seconds
PICTURES = frozenset(["view.jpg", "thumb.jpg"])

router = APIRouter(prefix="/api")


def _manager(request: Request) -> SessionManager:
    manager: SessionManager = request.app.state.manager
    return manager


Manager = Annotated[SessionManager, Depends(_manager)]
Name = Annotated[str, Query(max_length=1000)]


class NewSession(BaseModel):
    """The settings of a new session; without a ``board`` it is detected in the photographs."""

    board: str | None = Field(None, max_length=100)
    square_mm: float | None = Field(None, gt=0, lt=1e5)


class SessionChange(NewSession):
    """Settings of a session to change; those that are not given stay."""

    mirrored: bool = False


class PhotographChange(BaseModel):
    """Settings of a photograph to change."""

    included: bool


@router.get("/about")
async def about(manager: Manager) -> Event:
    """Version, export formats, paper sizes and upload limits."""
    return {
        "version": __version__,
        "formats": [{"name": name, "title": title} for name, title in FORMATS.items()],
        "pages": list(PAGES),
        "photograph_bytes": manager.context.limits.photograph_bytes,
        "video_bytes": manager.context.limits.video_bytes,
    }


# --- sessions ---


@router.get("/sessions")
async def sessions(manager: Manager) -> list[Event]:
    """All sessions, newest first."""
    return [summary(session) for session in map(manager.context.store.get, manager.context.store.ids()) if session]


@router.post("/sessions", status_code=201)
async def create_session(manager: Manager, new: NewSession) -> Event:
    """Create a session."""
    session = manager.create(parse_board(new.board) if new.board else None, new.square_mm)
    return {"id": session.id}


@router.patch("/sessions/{session_id}")
async def change_session(manager: Manager, session_id: str, change: SessionChange) -> Event:
    """Change a session."""
    changes: dict[str, Any] = change.model_dump(exclude_unset=True)
    if "board" in changes:
        changes["board"] = parse_board(changes["board"]) if changes["board"] else None
    manager.change(session_id, **changes)
    return {}


@router.delete("/sessions/{session_id}")
async def delete_session(manager: Manager, session_id: str) -> Event:
    """Delete a session and its files."""
    manager.delete(session_id)
    return {}


@router.get("/sessions/{session_id}/events")
async def events(manager: Manager, session_id: str) -> StreamingResponse:
    """A snapshot of a session, then every change, as server-sent events."""
    return StreamingResponse(_stream(manager, session_id), media_type="text/event-stream")


async def _stream(manager: SessionManager, session_id: str) -> AsyncIterator[str]:
    if manager.context.store.get(session_id) is None:
        yield _as_event({"kind": "gone"})
        return
    state = manager.context.state(session_id)
    with state.subscribe() as queue:
        yield _as_event(snapshot(manager, session_id))
        while True:
            try:
                yield _as_event(await asyncio.wait_for(queue.get(), HEARTBEAT))
            except TimeoutError:
                yield ": still here\n\n"


def snapshot(manager: SessionManager, session_id: str) -> Event:
    """The complete state of a session, for a page that opens."""
    session, state = manager.context.session(session_id), manager.context.state(session_id)
    return {
        "kind": "snapshot",
        "session": session_event(session),
        "photographs": [photograph_event(p) for p in session.photographs],
        "activity": state.activity,
        **result_event(session, state),
    }


def _as_event(data: Event) -> str:
    return f"data: {json.dumps(data, allow_nan=False)}\n\n"


@router.get("/sessions/{session_id}")
async def session(manager: Manager, session_id: str) -> Event:
    """The complete state of a session."""
    return snapshot(manager, session_id)


@router.post("/sessions/{session_id}/solve")
async def solve(manager: Manager, session_id: str) -> Event:
    """Calibrate now."""
    manager.context.session(session_id)
    manager.calibrator.request(session_id, at_once=True)
    return {}


@router.post("/sessions/{session_id}/cancel")
async def cancel(manager: Manager, session_id: str) -> Event:
    """Cancel the session's long work."""
    manager.cancel(session_id)
    return {}


# --- photographs ---


@router.post("/sessions/{session_id}/photographs", status_code=201)
async def add_photograph(manager: Manager, session_id: str, request: Request, name: Name) -> Event:
    """Add the photograph in the body."""
    arrived = await _received(manager, session_id, request)
    return photograph_event(await manager.uploads.add_photograph(session_id, arrived, name))


@router.post("/sessions/{session_id}/frames")
async def add_frame(manager: Manager, session_id: str, request: Request) -> Event:
    """Inspect the frame of a live camera in the body."""
    return await manager.uploads.add_frame(session_id, await _received(manager, session_id, request))


@router.post("/sessions/{session_id}/videos", status_code=202)
async def add_video(manager: Manager, session_id: str, request: Request, name: Name) -> Event:
    """Choose frames of the video in the body."""
    manager.uploads.add_video(session_id, await _received(manager, session_id, request), name)
    return {}


async def _received(manager: SessionManager, session_id: str, request: Request) -> Path:
    """The file with the body of ``request``; it is removed if the body does not arrive completely."""
    manager.uploads.check_limits(session_id)
    path = manager.context.store.arriving(session_id)
    try:
        with open(path, "xb") as file:
            async for chunk in request.stream():
                file.write(chunk)
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return path


@router.patch("/sessions/{session_id}/photographs/{photograph_id}")
async def change_photograph(manager: Manager, session_id: str, photograph_id: str, change: PhotographChange) -> Event:
    """Include or exclude a photograph."""
    manager.uploads.include(session_id, photograph_id, change.included)
    return {}


@router.delete("/sessions/{session_id}/photographs/{photograph_id}")
async def delete_photograph(manager: Manager, session_id: str, photograph_id: str) -> Event:
    """Remove a photograph."""
    manager.uploads.remove(session_id, photograph_id)
    return {}


@router.get("/sessions/{session_id}/photographs/{photograph_id}/straight.jpg")
async def straight(manager: Manager, session_id: str, photograph_id: str) -> FileResponse:
    """A photograph straightened by the newest result."""
    return FileResponse(await manager.calibrator.straight(session_id, photograph_id), media_type="image/jpeg")


@router.get("/sessions/{session_id}/photographs/{photograph_id}/{picture}")
async def picture(manager: Manager, session_id: str, photograph_id: str, picture: str) -> FileResponse:
    """A reduced copy of a photograph."""
    known = manager.context.session(session_id).photograph(photograph_id)
    if known is None or picture not in PICTURES:
        raise NotFound("there is no such picture; it may have been removed")
    return FileResponse(manager.context.store.path(session_id, known.id, picture), media_type="image/jpeg")


# --- downloads ---


@router.get("/sessions/{session_id}/camera.npz")
async def camera(manager: Manager, session_id: str) -> FileResponse:
    """The camera file."""
    path = manager.calibrator.camera(session_id)
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


@router.get("/sessions/{session_id}/report.html")
async def report(manager: Manager, session_id: str) -> FileResponse:
    """The report of the camera as a download, written on the first request."""
    path = await manager.calibrator.report(session_id)
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


@router.get("/sessions/{session_id}/report")
async def open_report(manager: Manager, session_id: str) -> FileResponse:
    """The report as a page in a sandbox, which may run only the script within it."""
    path = await manager.calibrator.report(session_id)
    return FileResponse(path, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})


@router.get("/sessions/{session_id}/corners.vnl")
async def corners(manager: Manager, session_id: str) -> FileResponse:
    """The corners of all included photographs as a table."""
    corner_set = manager.context.session(session_id).corner_set()
    if corner_set is None:
        raise NotFound("no photograph shows the board yet")
    return await _download(manager, manager.context.store.arriving(session_id), downloads.corner_table, corner_set)


@router.get("/sessions/{session_id}/export/{format_name}")
async def export(manager: Manager, session_id: str, format_name: str) -> FileResponse:
    """The camera in another program's format."""
    arguments = manager.calibrator.camera(session_id), format_name
    return await _download(manager, manager.context.store.arriving(session_id), downloads.export, *arguments)


@router.get("/board")
async def board(
    manager: Manager, board: Name, square_mm: float, page: Name = "A4", ending: Name = ".pdf"
) -> FileResponse:
    """A board to print."""
    if ending not in BOARD_FORMATS:
        raise InputError(f"unknown board format '{ending}': choose one of {', '.join(BOARD_FORMATS)}")
    arguments = parse_board(board), square_mm, page, ending
    folder = manager.context.store.folder / f"arriving-{new_id()}"
    return await _download(manager, folder, downloads.board_sheet, *arguments)


async def _download(manager: SessionManager, folder: Path, make: Function, *arguments: object) -> FileResponse:
    """The file that ``make`` writes into ``folder``, which is removed after the download or a failure."""
    try:
        file: downloads.Download = await manager.context.pool.run(make, folder, *arguments)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    cleanup = BackgroundTask(shutil.rmtree, folder, ignore_errors=True)
    notes = {"x-notes": quote(json.dumps(file.notes))} if file.notes else None
    return FileResponse(file.path, 200, notes, "application/octet-stream", cleanup, file.path.name)
