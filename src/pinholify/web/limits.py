"""Limits on what the app accepts: request bodies, photographs, sessions."""

from __future__ import annotations

from dataclasses import dataclass

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pinholify.errors import InputError
from pinholify.io.images import MAX_PIXELS

MEGABYTE = 1_000_000


class LimitExceeded(InputError):
    """A request exceeds one of the app's limits."""


@dataclass(frozen=True, slots=True)
class Limits:
    """The largest size of an upload of each kind and of any other request in bytes, and the largest numbers.

    ``pixels`` is per photograph and ``photographs`` per session. ``session_bytes`` is the total size of a session's
    photographs as uploaded, ``video_frames`` the number of frames that are chosen from a video.
    """

    photograph_bytes: int = 200 * MEGABYTE
    video_bytes: int = 4000 * MEGABYTE
    request_bytes: int = 65_536
    pixels: int = MAX_PIXELS
    photographs: int = 400
    session_bytes: int = 8000 * MEGABYTE
    sessions: int = 200
    video_frames: int = 60

    def body(self, path: str) -> int:
        """The largest body of a request to ``path``, in bytes."""
        if path.endswith("/videos"):
            return self.video_bytes
        if path.endswith(("/photographs", "/frames")):
            return self.photograph_bytes
        return self.request_bytes


@dataclass(frozen=True, slots=True)
class BodyLimit:
    """ASGI middleware that raises LimitExceeded when a body larger than ``limits`` allow is read."""

    app: ASGIApp
    limits: Limits

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        allowed, received = self.limits.body(scope["path"]), 0

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if max(received, _announced(scope)) > allowed:
                raise LimitExceeded(f"the upload is larger than {_size(allowed)}; send a smaller file")
            return message

        await self.app(scope, counted, send)


def _announced(scope: Scope) -> int:
    """The length of the body according to the request's header; 0 if it gives none."""
    values = [value for name, value in scope["headers"] if name == b"content-length"]
    return int(values[0]) if values and values[0].isdigit() else 0


def _size(count: int) -> str:
    return f"{count / MEGABYTE:.0f} MB" if count >= MEGABYTE else f"{count / 1000:.0f} kB"
