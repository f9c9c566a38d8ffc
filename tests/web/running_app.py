"""What the tests of the app share: a running app, sending photographs, waiting for the camera."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import uvicorn

from pinholify.web.app import create_app
from pinholify.web.limits import Limits
from pinholify.web.server import listening

TOKEN = "token-of-the-tests"
PATIENCE = 90.0  # seconds, on a busy computer
LIMITS = Limits(photograph_bytes=20_000_000, video_bytes=40_000_000, pixels=4_000_000, photographs=40, sessions=80)


@dataclass(frozen=True)
class App:
    """A running app: its address without the token, and its folder."""

    url: str
    folder: Path

    @property
    def address(self) -> str:
        """What the terminal would show."""
        return f"{self.url}/?token={TOKEN}"

    def files(self) -> set[Path]:
        """All files it keeps."""
        return {path.relative_to(self.folder) for path in self.folder.rglob("*") if path.is_file()}


@contextmanager
def running(folder: Path, limits: Limits = LIMITS, *, token: str = TOKEN) -> Iterator[App]:
    """An app over ``folder``, served by a thread on a free port of this computer."""
    with listening("127.0.0.1", 0) as listener:
        made = create_app(folder, token, limits, workers=2)
        server = uvicorn.Server(uvicorn.Config(made, log_level="critical", timeout_graceful_shutdown=1))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        try:
            yield App(f"http://127.0.0.1:{listener.getsockname()[1]}", folder)
        finally:
            server.should_exit = True
            thread.join(20)


@contextmanager
def opened(app: App) -> Iterator[httpx.Client]:
    """A client that has opened the page."""
    with httpx.Client(base_url=app.url, headers={"x-pinholify": "1"}, timeout=PATIENCE) as client:
        assert client.get("/", params={"token": TOKEN}).status_code == 200
        yield client


def new_session(client: httpx.Client, **values: object) -> str:
    """A new session's id."""
    made: str = client.post("/api/sessions", json=values).json()["id"]
    return made


def add(client: httpx.Client, session: str, path: Path, name: str | None = None) -> httpx.Response:
    """Send a photograph."""
    return client.post(
        f"/api/sessions/{session}/photographs", params={"name": name or path.name}, content=path.read_bytes()
    )


def settled(client: httpx.Client, session: str) -> dict[str, Any]:
    """The session once nothing goes on in it and it has a camera of its photographs, or a problem."""

    def done(state: dict[str, Any]) -> bool:
        if state["activity"] is not None or state["pending"]:
            return False
        return bool(state["problem"] or (state["final"] and not outdated(state)))

    return until(client, session, done)


def until(client: httpx.Client, session: str, done: Any) -> dict[str, Any]:
    """The session as soon as ``done`` says so of it."""
    deadline = time.monotonic() + PATIENCE
    while True:
        state: dict[str, Any] = client.get(f"/api/sessions/{session}").json()
        if done(state):
            return state
        assert time.monotonic() < deadline, (state["activity"], state["problem"], state["result"] is not None)
        time.sleep(0.05)


def outdated(state: dict[str, Any]) -> bool:
    """Whether the result is of other photographs than those that count."""
    return set(state["result"]["photographs"]) != set(state["session"]["usable"])
