"""A pool of processes for long work, which can report messages and be cancelled at once.

A working process can be killed at any time, and one that dies (a picture that crashes a decoder, lack of memory)
affects nothing else. Processes are spawned, and kept for further work.
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

Report = Callable[[Any], None]
"""Sends a message from a working process to the caller of :meth:`ProcessPool.run`."""

Function = Callable[..., Any]
"""Work to run in another process: a function of a module, with arguments that can be pickled."""

FEWEST, MOST = 3, 6  # processes: one to calibrate, one to inspect uploads, one to serve downloads

log = logging.getLogger("pinholify.web")


class WorkerError(PinholifyError):
    """Work ended without a result, for a reason that the user cannot correct."""


class ProcessPool:
    """``size`` processes, by default a number that suits this computer.

    All methods must be called in the thread of one event loop.
    """

    def __init__(self, size: int | None = None) -> None:
        """Starts no process yet."""
        self._size = size or max(FEWEST, min(MOST, os.cpu_count() or 1))
        self._slots = asyncio.Semaphore(self._size)
        self._idle: list[_Worker] = []
        self._busy: set[_Worker] = set()
        self._listeners = ThreadPoolExecutor(self._size, thread_name_prefix="pinholify-work")

    def fill(self) -> None:
        """Start the missing processes, so that they are ready when work arrives."""
        while len(self._idle) + len(self._busy) < self._size:
            self._idle.append(_Worker())

    async def run(self, function: Function, *arguments: object, on_message: Report | None = None) -> Any:
        """The result of ``function(*arguments)`` in a process.

        With ``on_message`` it is ``function(report, *arguments)``, and ``on_message`` is called with each message that
        the function passes to ``report``. Raises the PinholifyError that the function raises, and WorkerError where it
        fails otherwise or its process dies. Cancelling the waiting task kills the process.
        """
        async with self._slots:
            self.fill()
            worker = self._idle.pop(0)
            self._busy.add(worker)
            try:
                return await worker.run(function, arguments, on_message, self._listeners)
            finally:
                self._busy.discard(worker)
                if worker.ready:
                    self._idle.append(worker)
                else:
                    worker.end()
                    self.fill()

    def close(self) -> None:
        """End all processes; no work may be running."""
        while self._idle:
            self._idle.pop().end()
        self._listeners.shutdown(wait=False, cancel_futures=True)


class _Worker:
    """A process and the pipe to it; ``ready`` unless it is working, was abandoned while working, or is dead."""

    def __init__(self) -> None:
        self.ready = True
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(target=_serve, args=(theirs,), daemon=True, name="pinholify")
        with interrupts_ignored():
            self._process.start()
        theirs.close()

    async def run(
        self,
        function: Function,
        arguments: tuple[object, ...],
        on_message: Report | None,
        listeners: ThreadPoolExecutor,
    ) -> Any:
        self.ready = False
        try:
            self._pipe.send((function, arguments, on_message is not None))
            while (answer := await self._answer(listeners))[0] == "message":
                if on_message is not None:
                    on_message(answer[1])
        except (EOFError, OSError):
            raise WorkerError(
                "the process ended before the work was done, perhaps for lack of memory; try again, or use smaller "
                "photographs"
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
        """Kill the process; its pipe is closed when nothing reads from it any more.

        If it were closed at once, the next process's pipe could get its file descriptor before a listener reads again,
        and the listener would take that process's answer.
        """
        self._process.kill()
        self._process.join(5.0)


def _serve(pipe: Connection) -> None:
    """The main loop of a process: runs functions until the app closes the pipe or kills it."""
    be_a_worker()
    importlib.import_module("pinholify.web.solving")  # slow to load, so before the first work arrives

    def report(message: Any) -> None:
        pipe.send(("message", message))

    while True:
        try:
            function, arguments, reports = pipe.recv()
            pipe.send(_outcome(function, (report, *arguments) if reports else arguments))
        except (EOFError, OSError):
            return


def _outcome(function: Function, arguments: tuple[object, ...]) -> tuple[str, Any]:
    try:
        return "done", function(*arguments)
    except PinholifyError as error:
        return "failed", type(error)(str(error))
    except MemoryError:
        return "failed", WorkerError("there is not enough memory for images of this size; use smaller ones")
    except Exception:
        log.exception("%s failed", function.__name__)
        return "failed", WorkerError("an internal error occurred; see the terminal for details")
