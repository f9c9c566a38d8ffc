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
from pinholify.web.limits import Bounded, Limits, TooMuch
from pinholify.web.routes import router
from pinholify.web.security import HEADER, Guard, refused
from pinholify.web.studio import Studio
from pinholify.web.work import WorkError
from pinholify.web.workroom import NotThere

STATIC = Path(__file__).parent / "static"
STATUS: dict[type[PinholifyError], int] = {TooMuch: 413, NotThere: 404, WorkError: 500}

PAGE, REFUSED = "page", "x-refused"

log = logging.getLogger("pinholify.web")


def create_app(
    folder: Path, token: str, limits: Limits | None = None, *, host: str = "127.0.0.1", workers: int | None = None
) -> FastAPI:
    """The app over the sessions in ``folder``, for whoever holds ``token``.

    ``host`` is the name it listens on, ``workers`` how many processes calibrate. Raises OutputError where the folder
    cannot be made.
    """
    chosen = limits or Limits()
    studio = Studio(folder, chosen, workers)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        studio.room.crew.fill()
        yield
        await studio.close()

    app = FastAPI(title="pinholify", lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
    app.state.studio = studio
    app.include_router(router)
    app.add_api_route("/", _page, include_in_schema=False)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    app.add_middleware(Bounded, limits=chosen)
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
    # The page is told in a header: browsers write every other status to the console as an error of the page's.
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
    return JSONResponse({"error": "something went wrong inside; the terminal says more"}, 500)
