"""The app as one ASGI application."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException

from pinholify.errors import PinholifyError
from pinholify.web.context import NotFound
from pinholify.web.limits import BodyLimit, LimitExceeded, Limits
from pinholify.web.manager import SessionManager
from pinholify.web.process_pool import WorkerError
from pinholify.web.routes import router
from pinholify.web.security import HEADER, Guard, refused

STATIC = Path(__file__).parent / "static"
STATUS: dict[type[PinholifyError], int] = {LimitExceeded: 413, NotFound: 404, WorkerError: 500}

PAGE, REFUSED = "page", "x-refused"

log = logging.getLogger("pinholify.web")


def create_app(
    folder: Path, token: str, limits: Limits | None = None, *, host: str = "127.0.0.1", workers: int | None = None
) -> FastAPI:
    """The app for the sessions in ``folder``; requests must carry ``token``.

    ``host`` is the name on which it listens, ``workers`` the number of processes for long work. Raises OutputError if
    the folder cannot be created.
    """
    chosen = limits or Limits()
    manager = SessionManager(folder, chosen, workers)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        manager.context.pool.fill()
        yield
        await manager.close()

    app = FastAPI(title="pinholify", lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
    app.state.manager = manager
    app.include_router(router)
    app.add_api_route("/", _page, include_in_schema=False)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    app.add_middleware(BodyLimit, limits=chosen)
    app.add_middleware(Guard, token=token, host=host)
    app.add_exception_handler(PinholifyError, _refused)
    app.add_exception_handler(RequestValidationError, _not_understood)
    app.add_exception_handler(HTTPException, _no_such_address)
    app.add_exception_handler(Exception, _failed)
    return app


def _page() -> FileResponse:
    return FileResponse(STATIC / "index.html")


async def _refused(request: Request, error: Exception) -> Response:
    status = STATUS.get(type(error), 422)  # type: ignore[arg-type]
    # The status goes into a header for the page: browsers log any other status than 200 as an error of the page.
    if request.headers.get(HEADER) == PAGE:
        return JSONResponse({"error": str(error)}, 200, {REFUSED: str(status)})
    return refused(request, status, str(error))


async def _not_understood(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    return JSONResponse({"error": f"{first['loc'][-1]}: {first['msg']}"}, 422)


async def _no_such_address(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": str(error.detail)}, error.status_code)


async def _failed(request: Request, error: Exception) -> JSONResponse:
    log.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return JSONResponse({"error": "an internal error occurred; see the terminal for details"}, 500)
