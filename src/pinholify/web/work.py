"""Work that takes time, in processes of its own: it reports how far it is, and ends at once when it is cancelled.

A process that works can be ended at any moment, and one that dies (a picture that crashes a decoder, too little
memory) takes nothing with it. Processes are spawned and kept for the next work.
"""

from __future__ import annotations

import asyncio
import importlib
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

FEWEST, MOST = 3, 6  # processes: one calibrates, one looks at what arrives, one answers

log = logging.getLogger("pinholify.web")


class WorkError(PinholifyError):
    """Work ended without a result and without a reason a person could mend."""


class Crew:
    """``size`` processes, by default as many as suit this computer. All methods are for one event loop's thread."""

    def __init__(self, size: int | None = None) -> None:
        """No process is started yet."""
        self._size = size or max(FEWEST, min(MOST, os.cpu_count() or 1))
        self._room = asyncio.Semaphore(self._size)
        self._idle: list[_Worker] = []
        self._busy: set[_Worker] = set()
        self._listeners = ThreadPoolExecutor(self._size, thread_name_prefix="pinholify-work")

    def fill(self) -> None:
        """Start the processes that are missing, so that work finds them ready."""
        while len(self._idle) + len(self._busy) < self._size:
            self._idle.append(_Worker())

    async def run(self, function: Function, *arguments: object, heard: Callable[[Any], None] | None = None) -> Any:
        """``function(say, *arguments)`` in a process; ``heard`` gets all that it says.

        Raises the PinholifyError it raises, and WorkError where it dies or fails otherwise. When the task that waits
        here is cancelled, the process is ended.
        """
        async with self._room:
            self.fill()
            worker = self._idle.pop(0)
            self._busy.add(worker)
            try:
                return await worker.do(function, arguments, heard, self._listeners)
            finally:
                self._busy.discard(worker)
                if worker.ready:
                    self._idle.append(worker)
                else:
                    worker.end()
                    self.fill()

    def close(self) -> None:
        """End all processes; no work may be under way."""
        while self._idle:
            self._idle.pop().end()
        self._listeners.shutdown(wait=False, cancel_futures=True)


class _Worker:
    """One process and the pipe to it; ``ready`` unless it works, was left at work, or is dead."""

    def __init__(self) -> None:
        self.ready = True
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(target=_serve, args=(theirs,), daemon=True, name="pinholify")
        with interrupts_ignored():
            self._process.start()
        theirs.close()

    async def do(
        self, function: Function, arguments: tuple[object, ...], heard: Say | None, listeners: ThreadPoolExecutor
    ) -> Any:
        self.ready = False
        try:
            self._pipe.send((function, arguments))
            while (answer := await self._answer(listeners))[0] == "said":
                if heard is not None:
                    heard(answer[1])
        except (EOFError, OSError):
            raise WorkError(
                "the work ended before it was done, perhaps for want of memory; try again, or with smaller photographs"
            ) from None
        self.ready = True
        kind, value = answer
        if kind == "failed":
            raise value
        return value

    async def _answer(self, listeners: ThreadPoolExecutor) -> tuple[str, Any]:
        answer: tuple[str, Any] = await asyncio.get_running_loop().run_in_executor(listeners, self._pipe.recv)
        return answer

    def end(self) -> None:
        """End the process; its pipe is closed when nobody reads from it any more.

        Closed at once, its number could be that of the next process's pipe before a listener, which was about to read
        on, does so, and would take that one's answer.
        """
        self._process.kill()
        self._process.join(5.0)


def _serve(pipe: Connection) -> None:
    """The life of a process: work after work, until the app closes the pipe or ends it."""
    be_a_worker()
    importlib.import_module("pinholify.web.solving")  # now, not when somebody waits for it
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
