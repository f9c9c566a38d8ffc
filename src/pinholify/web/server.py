"""Serving the app: the port, the token, the browser."""

from __future__ import annotations

import secrets
import socket
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import uvicorn

from pinholify.errors import InputError
from pinholify.web.app import create_app
from pinholify.web.limits import Limits

GRACE = 1  # seconds for open connections to close when the app ends


def listening(host: str, port: int) -> socket.socket:
    """A socket that listens on ``host`` and ``port`` (0: any free port); raises InputError if it cannot."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"the app cannot listen on {host}, port {port}: {reason}; choose another --port") from None


def serve(folder: Path, host: str, port: int, *, browser: bool, announce: Callable[[str], None]) -> None:
    """Serve until interrupted; ``announce`` is called with the address, which contains the token.

    Raises InputError if the port is in use, OutputError if ``folder`` cannot be created.
    """
    token = secrets.token_urlsafe(24)
    app = create_app(folder, token, Limits(), host=host)
    listener = listening(host, port)
    name = f"[{host}]" if ":" in host else host
    address = f"http://{name}:{listener.getsockname()[1]}/?token={token}"
    config = uvicorn.Config(app, log_level="critical", lifespan="on", timeout_graceful_shutdown=GRACE)
    announce(address)
    if browser:
        webbrowser.open(address)
    with listener, suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listener])
