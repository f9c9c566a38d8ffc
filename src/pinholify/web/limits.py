"""How much the app takes: bodies, photographs, sessions."""

from __future__ import annotations

from dataclasses import dataclass

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pinholify.errors import InputError
from pinholify.io.images import MAX_PIXELS

MEGABYTE = 1_000_000


class TooMuch(InputError):
    """More was sent than the app takes."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bytes of one upload of each kind and of any other request, pixels, and how many of everything.

    ``session_bytes`` counts the photographs of one session as they were sent. ``video_frames`` is how many frames of
    one video are kept at most.
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
        """The largest body in bytes of a request to ``path``."""
        if path.endswith("/videos"):
            return self.video_bytes
        if path.endswith(("/photographs", "/frames")):
            return self.photograph_bytes
        return self.request_bytes


@dataclass(frozen=True, slots=True)
class Bounded:
    """ASGI middleware that reads no more of a body than ``limits`` allow; raises TooMuch into whoever reads it."""

    app: ASGIApp
    limits: Limits

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        allowed, received = self.limits.body(scope["path"]), 0

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if max(received, _announced(scope)) > allowed:
                raise TooMuch(f"more than {_size(allowed)} were sent at once; send a smaller file")
            return message

        await self.app(scope, counted, send)


def _announced(scope: Scope) -> int:
    """The length of the body that the request's header tells, 0 where it tells none."""
    values = [value for name, value in scope["headers"] if name == b"content-length"]
    return int(values[0]) if values and values[0].isdigit() else 0


def _size(count: int) -> str:
    return f"{count / MEGABYTE:.0f} MB" if count >= MEGABYTE else f"{count / 1000:.0f} kB"
