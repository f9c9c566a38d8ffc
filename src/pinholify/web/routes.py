"""The app's addresses: each one line of what it does, all of it done by the studio."""

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
from pinholify.web.desk import Event, photograph_event, result_event, session_event
from pinholify.web.security import REPORT_POLICY
from pinholify.web.sessions import new_id
from pinholify.web.studio import Studio, summary
from pinholify.web.work import Function
from pinholify.web.workroom import NotThere

HEARTBEAT = 15.0  # seconds
PICTURES = frozenset(["view.jpg", "thumb.jpg"])

router = APIRouter(prefix="/api")


def _studio(request: Request) -> Studio:
    studio: Studio = request.app.state.studio
    return studio


TheStudio = Annotated[Studio, Depends(_studio)]
Name = Annotated[str, Query(max_length=1000)]


class NewSession(BaseModel):
    """What a session starts with; no ``board`` means that the photographs shall tell it."""

    board: str | None = Field(None, max_length=100)
    square_mm: float | None = Field(None, gt=0, lt=1e5)


class SessionChange(NewSession):
    """What of a session shall change; what is not named stays."""

    mirrored: bool = False


class PhotographChange(BaseModel):
    """What of a photograph shall change."""

    included: bool


@router.get("/about")
async def about(studio: TheStudio) -> Event:
    """What the app can do and how much it takes."""
    return {
        "version": __version__,
        "formats": [{"name": name, "title": title} for name, title in FORMATS.items()],
        "pages": list(PAGES),
        "photograph_bytes": studio.room.limits.photograph_bytes,
        "video_bytes": studio.room.limits.video_bytes,
    }


# --- sessions ---


@router.get("/sessions")
async def sessions(studio: TheStudio) -> list[Event]:
    """All sessions, the newest first."""
    return [summary(session) for session in map(studio.room.store.get, studio.room.store.ids()) if session]


@router.post("/sessions", status_code=201)
async def create_session(studio: TheStudio, new: NewSession) -> Event:
    """A new session."""
    session = studio.create(parse_board(new.board) if new.board else None, new.square_mm)
    return {"id": session.id}


@router.patch("/sessions/{session_id}")
async def change_session(studio: TheStudio, session_id: str, change: SessionChange) -> Event:
    """Change a session."""
    changes: dict[str, Any] = change.model_dump(exclude_unset=True)
    if "board" in changes:
        changes["board"] = parse_board(changes["board"]) if changes["board"] else None
    studio.change(session_id, **changes)
    return {}


@router.delete("/sessions/{session_id}")
async def delete_session(studio: TheStudio, session_id: str) -> Event:
    """Delete a session and its files."""
    studio.delete(session_id)
    return {}


@router.get("/sessions/{session_id}/events")
async def events(studio: TheStudio, session_id: str) -> StreamingResponse:
    """All of a session, then every change of it, as server-sent events."""
    return StreamingResponse(_stream(studio, session_id), media_type="text/event-stream")


async def _stream(studio: Studio, session_id: str) -> AsyncIterator[str]:
    if studio.room.store.get(session_id) is None:
        yield _as_event({"kind": "gone"})
        return
    desk = studio.room.desk(session_id)
    with desk.watching() as queue:
        yield _as_event(snapshot(studio, session_id))
        while True:
            try:
                yield _as_event(await asyncio.wait_for(queue.get(), HEARTBEAT))
            except TimeoutError:
                yield ": still here\n\n"


def snapshot(studio: Studio, session_id: str) -> Event:
    """A session as a page needs it when it opens."""
    session, desk = studio.room.session(session_id), studio.room.desk(session_id)
    return {
        "kind": "snapshot",
        "session": session_event(session),
        "photographs": [photograph_event(p) for p in session.photographs],
        "activity": desk.activity,
        **result_event(session, desk),
    }


def _as_event(data: Event) -> str:
    return f"data: {json.dumps(data, allow_nan=False)}\n\n"


@router.get("/sessions/{session_id}")
async def session(studio: TheStudio, session_id: str) -> Event:
    """All of a session, once."""
    return snapshot(studio, session_id)


@router.post("/sessions/{session_id}/solve")
async def solve(studio: TheStudio, session_id: str) -> Event:
    """Calibrate now."""
    studio.room.session(session_id)
    studio.calibrator.want(session_id, at_once=True)
    return {}


@router.post("/sessions/{session_id}/cancel")
async def cancel(studio: TheStudio, session_id: str) -> Event:
    """End the session's long work."""
    studio.cancel(session_id)
    return {}


# --- photographs ---


@router.post("/sessions/{session_id}/photographs", status_code=201)
async def add_photograph(studio: TheStudio, session_id: str, request: Request, name: Name) -> Event:
    """Add the photograph in the body."""
    arrived = await _received(studio, session_id, request)
    return photograph_event(await studio.intake.add_photograph(session_id, arrived, name))


@router.post("/sessions/{session_id}/frames")
async def add_frame(studio: TheStudio, session_id: str, request: Request) -> Event:
    """Look at the frame of a live camera in the body."""
    return await studio.intake.add_frame(session_id, await _received(studio, session_id, request))


@router.post("/sessions/{session_id}/videos", status_code=202)
async def add_video(studio: TheStudio, session_id: str, request: Request, name: Name) -> Event:
    """Choose frames of the video in the body."""
    studio.intake.add_video(session_id, await _received(studio, session_id, request), name)
    return {}


async def _received(studio: Studio, session_id: str, request: Request) -> Path:
    """The body of ``request`` in a file of the session; nothing stays where it does not arrive whole."""
    studio.intake.check_room(session_id)
    path = studio.room.store.arriving(session_id)
    try:
        with open(path, "xb") as file:
            async for chunk in request.stream():
                file.write(chunk)
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return path


@router.patch("/sessions/{session_id}/photographs/{photograph_id}")
async def change_photograph(studio: TheStudio, session_id: str, photograph_id: str, change: PhotographChange) -> Event:
    """Include or exclude a photograph."""
    studio.intake.include(session_id, photograph_id, change.included)
    return {}


@router.delete("/sessions/{session_id}/photographs/{photograph_id}")
async def delete_photograph(studio: TheStudio, session_id: str, photograph_id: str) -> Event:
    """Remove a photograph."""
    studio.intake.remove(session_id, photograph_id)
    return {}


@router.get("/sessions/{session_id}/photographs/{photograph_id}/straight.jpg")
async def straight(studio: TheStudio, session_id: str, photograph_id: str) -> FileResponse:
    """A photograph straightened by the newest result."""
    return FileResponse(await studio.calibrator.straight(session_id, photograph_id), media_type="image/jpeg")


@router.get("/sessions/{session_id}/photographs/{photograph_id}/{picture}")
async def picture(studio: TheStudio, session_id: str, photograph_id: str, picture: str) -> FileResponse:
    """A photograph as pages show it."""
    known = studio.room.session(session_id).photograph(photograph_id)
    if known is None or picture not in PICTURES:
        raise NotThere("there is no such picture; it may have been removed")
    return FileResponse(studio.room.store.path(session_id, known.id, picture), media_type="image/jpeg")


# --- downloads ---


@router.get("/sessions/{session_id}/camera.npz")
async def camera(studio: TheStudio, session_id: str) -> FileResponse:
    """The camera file."""
    path = studio.calibrator.camera(session_id)
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


@router.get("/sessions/{session_id}/report.html")
async def report(studio: TheStudio, session_id: str) -> FileResponse:
    """The report of the camera, made when it is first asked for."""
    path = await studio.calibrator.report(session_id)
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


@router.get("/sessions/{session_id}/report")
async def open_report(studio: TheStudio, session_id: str) -> FileResponse:
    """The report as a page to read: a stranger to the app, who may run no more than the script within."""
    path = await studio.calibrator.report(session_id)
    return FileResponse(path, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})


@router.get("/sessions/{session_id}/corners.vnl")
async def corners(studio: TheStudio, session_id: str) -> FileResponse:
    """The corners of all photographs that count, as a table."""
    corner_set = studio.room.session(session_id).corner_set()
    if corner_set is None:
        raise NotThere("no photograph shows the board yet")
    return await _made(studio, studio.room.store.arriving(session_id), downloads.corner_table, corner_set)


@router.get("/sessions/{session_id}/export/{format_name}")
async def export(studio: TheStudio, session_id: str, format_name: str) -> FileResponse:
    """The camera in another program's format."""
    arguments = studio.calibrator.camera(session_id), format_name
    return await _made(studio, studio.room.store.arriving(session_id), downloads.export, *arguments)


@router.get("/board")
async def board(
    studio: TheStudio, board: Name, square_mm: float, page: Name = "A4", ending: Name = ".pdf"
) -> FileResponse:
    """A board to print."""
    if ending not in BOARD_FORMATS:
        raise InputError(f"'{ending}' is no kind of file for a board; these are: {', '.join(BOARD_FORMATS)}")
    arguments = parse_board(board), square_mm, page, ending
    return await _made(studio, studio.room.store.folder / f"arriving-{new_id()}", downloads.board_sheet, *arguments)


async def _made(studio: Studio, folder: Path, make: Function, *arguments: object) -> FileResponse:
    """The file that ``make`` writes into ``folder``, which is removed when the browser has it, or when it fails."""
    try:
        made: downloads.Made = await studio.room.crew.run(make, folder, *arguments)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    forget = BackgroundTask(shutil.rmtree, folder, ignore_errors=True)
    notes = {"x-notes": quote(json.dumps(made.notes))} if made.notes else None
    return FileResponse(made.path, 200, notes, "application/octet-stream", forget, made.path.name)
