"""Work that takes time, in processes of its own: it reports how far it is, and ends at once when it is cancelled.

A process that works can be ended at any moment, and one that dies (a picture that crashes a decoder, too little
memory) takes nothing with it. Processes are spawned and kept for the next work.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from pinholify.errors import PinholifyError
from pinholify.io.processes import be_a_worker, interrupts_ignored

Say = Callable[[Any], None]
"""How work tells what it has so far."""

Function = Callable[..., Any]
"""Work: called with a :data:`Say` and then its arguments, in another process."""

log = logging.getLogger("pinholify.web")


class WorkError(PinholifyError):
    """Work ended without a result and without a reason a person could mend."""


class Crew:
    """Up to ``size`` processes, made when they are first needed. All methods are for one event loop's thread."""

    def __init__(self, size: int | None = None) -> None:
        """No process is started yet."""
        self._size = size or max(2, min(4, os.cpu_count() or 1))
        self._room = asyncio.Semaphore(self._size)
        self._idle: list[_Worker] = []
        self._all: set[_Worker] = set()
        self._listeners = ThreadPoolExecutor(self._size, thread_name_prefix="pinholify-work")

    async def warm_up(self) -> None:
        """Start the processes before they are needed."""
        await asyncio.gather(*(self.run(load) for _ in range(self._size)))

    async def run(self, function: Function, *arguments: object, heard: Callable[[Any], None] | None = None) -> Any:
        """``function(say, *arguments)`` in a process; ``heard`` gets all that it says.

        Raises the PinholifyError it raises, and WorkError where it dies or fails otherwise. When the task that waits
        here is cancelled, the process is ended.
        """
        async with self._room:
            worker = self._idle.pop() if self._idle else self._hired()
            try:
                result = await worker.do(function, arguments, heard, self._listeners)
            except PinholifyError as error:
                self._release(worker, keep=not isinstance(error, WorkError))
                raise
            except BaseException:
                self._release(worker, keep=False)
                raise
            self._release(worker, keep=True)
            return result

    def close(self) -> None:
        """End all processes."""
        for worker in list(self._all):
            self._release(worker, keep=False)
        self._listeners.shutdown(wait=False, cancel_futures=True)

    def _hired(self) -> _Worker:
        worker = _Worker()
        self._all.add(worker)
        return worker

    def _release(self, worker: _Worker, *, keep: bool) -> None:
        if keep:
            self._idle.append(worker)
            return
        self._all.discard(worker)
        if worker in self._idle:
            self._idle.remove(worker)
        worker.end()


class _Worker:
    """One process and the pipe to it."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(target=_serve, args=(theirs,), daemon=True, name="pinholify")
        with interrupts_ignored():
            self._process.start()
        theirs.close()

    async def do(
        self, function: Function, arguments: tuple[object, ...], heard: Say | None, listeners: ThreadPoolExecutor
    ) -> Any:
        loop = asyncio.get_running_loop()
        try:
            self._pipe.send((function, arguments))
            while True:
                kind, value = await loop.run_in_executor(listeners, self._pipe.recv)
                if kind == "done":
                    return value
                if kind == "failed":
                    raise value
                if heard is not None:
                    heard(value)
        except (EOFError, OSError):
            raise WorkError(
                "the work ended before it was done, perhaps for want of memory; try again, or with smaller photographs"
            ) from None

    def end(self) -> None:
        self._process.kill()
        self._process.join(5.0)
        self._pipe.close()


def _serve(pipe: Connection) -> None:
    """The life of a process: work after work, until the app closes the pipe or ends it."""
    be_a_worker()
    while True:
        try:
            function, arguments = pipe.recv()
            pipe.send(_outcome(function, arguments, lambda said: pipe.send(("said", said))))
        except (EOFError, OSError):
            return


def _outcome(function: Function, arguments: tuple[object, ...], say: Say) -> tuple[str, Any]:
    try:
        return "done", function(say, *arguments)
    except PinholifyError as error:
        return "failed", type(error)(str(error))
    except MemoryError:
        return "failed", WorkError("there is not enough memory for images of this size; give smaller ones")
    except Exception:
        log.exception("%s failed", function.__name__)
        return "failed", WorkError("something went wrong inside; the terminal says more")


def load(say: Say) -> None:
    """Import what the work will need."""
    import pinholify.web.looking
    import pinholify.web.solving  # noqa: F401
