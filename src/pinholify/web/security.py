"""Access control: the app answers only requests from its own pages that carry the token.

Every request must meet four conditions. Its ``Host`` is an IP address or a name that a foreign name server cannot point
here (DNS rebinding); it does not come from another site (``Sec-Fetch-Site``, ``Origin``); it carries the token, in a
cookie or, for the first page only, in the address; and if it changes anything, it carries a header that a form of
another site cannot send. The headers of every answer forbid pages to load anything from elsewhere.
"""

from __future__ import annotations

import hmac
import ipaddress
from dataclasses import dataclass

from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "pinholify-token"  # followed by the port: browsers share cookies among all ports of a host
HEADER = "x-pinholify"
SAFE_METHODS = frozenset(["GET", "HEAD"])

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; "
    "connect-src 'self'; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
)
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
)
"""For a report in its own tab: a sandbox without an origin, so that its script cannot send requests to the app."""

HEADERS = {
    b"content-security-policy": PAGE_POLICY.encode(),
    b"x-content-type-options": b"nosniff",
    b"referrer-policy": b"no-referrer",
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"permissions-policy": b"camera=(self), microphone=(), geolocation=()",
    b"cache-control": b"no-store",
}

REFUSAL_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>pinholify</title>
<body style="font:1.1rem/1.5 system-ui,sans-serif;max-width:34rem;margin:15vh auto;padding:0 1.5rem">
<h1>pinholify</h1><p>{sentence}</p></body></html>"""


@dataclass(frozen=True, slots=True)
class Guard:
    """ASGI middleware that passes a request to ``app`` or refuses it with a sentence.

    ``token`` is the secret of this run, ``host`` the name on which the app listens.
    """

    app: ASGIApp
    token: str
    host: str

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        request = Request(scope)
        refusal = self.refusal(request)
        answer: ASGIApp = self.app if refusal is None else refused(request, *refusal)
        await answer(scope, receive, self._with_headers(request, send))

    def refusal(self, request: Request) -> tuple[int, str] | None:
        """The status and the sentence with which ``request`` is refused, or None."""
        if not self._known_host(request):
            return 421, "This is not the address of the app; open the address shown in the terminal."
        if _from_elsewhere(request):
            return 403, "The request came from another site and was refused."
        if not self._has_token(request):
            return 403, "The address lacks the token of this run; open the address shown in the terminal."
        if request.method not in SAFE_METHODS and HEADER not in request.headers:
            return 403, "The request did not come from the app's own page and was refused."
        return None

    def _known_host(self, request: Request) -> bool:
        name = _host_name(request.headers.get("host", ""))
        return name in {"localhost", self.host.lower()} or _is_number(name)

    def _has_token(self, request: Request) -> bool:
        given = [request.cookies.get(_cookie(request), "")]
        if request.url.path == "/":
            given.append(request.query_params.get("token", ""))
        return any(hmac.compare_digest(text.encode(), self.token.encode()) for text in given)

    def _with_headers(self, request: Request, send: Send) -> Send:
        """A ``send`` that adds the common headers, and the cookie if the address contained the token."""
        cookie = f"{_cookie(request)}={self.token}; HttpOnly; SameSite=Strict; Path=/".encode()
        by_address = request.url.path == "/" and self._has_token(request)

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in message["headers"]}
                message["headers"] += [(name, value) for name, value in HEADERS.items() if name not in own]
                if by_address and message["status"] == 200:
                    message["headers"].append((b"set-cookie", cookie))
            await send(message)

        return sending


def _cookie(request: Request) -> str:
    return f"{COOKIE}-{request.scope['server'][1]}"


def _host_name(host: str) -> str:
    """``host`` without its port, in lower case."""
    name = host.rpartition("]")[0].lstrip("[") if host.startswith("[") else host.partition(":")[0]
    return name.lower()


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _from_elsewhere(request: Request) -> bool:
    """Whether a page of another site sent ``request``; following its link to the first page is allowed."""
    origin, site = request.headers.get("origin"), request.headers.get("sec-fetch-site", "same-origin")
    if origin is not None and origin != f"{request.url.scheme}://{request.headers.get('host', '')}":
        return True
    opened = request.url.path == "/" and request.method == "GET" and request.headers.get("sec-fetch-mode") == "navigate"
    return site not in {"same-origin", "none"} and not opened


def refused(request: Request, status: int, sentence: str) -> Response:
    """The answer to a refused request: a page for a browser, JSON for a program."""
    if "text/html" in request.headers.get("accept", ""):
        page = HTMLResponse(REFUSAL_PAGE.format(sentence=sentence), status)
        page.headers["content-security-policy"] = "default-src 'none'; style-src 'unsafe-inline'"
        return page
    return JSONResponse({"error": sentence}, status)
