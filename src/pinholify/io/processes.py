"""Worker processes: starting them, recovering the work of one that dies, and leaving Ctrl-C to their parent."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import TypeVar

from pinholify.errors import InputError
from pinholify.io.threads import one_blas_thread

AHEAD = 2
"""Items assigned to each process: one in progress and one waiting."""

DIED = "the process that worked on it died twice, perhaps for lack of memory"

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C inside the block; outside a program's main thread this has no effect.

    Processes started inside inherit the setting, so while they start, Ctrl-C reaches only the parent.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def be_a_worker() -> None:
    """Initialise a worker: one thread per process, and Ctrl-C left to the parent, which ends the pool."""
    one_blas_thread()
    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)


def in_processes(
    function: Callable[[_Item], _Result], items: Sequence[_Item], workers: int, *, died: Callable[[_Item], _Result]
) -> Iterator[_Result]:
    """Apply ``function`` to ``items`` in ``workers`` processes; yields results in order of completion.

    If a process dies, the items that may have caused it are retried one at a time; ``died`` gives the result of an item
    whose process dies again. Processes are spawned (a fork after OpenCV has run threads can hang), so a script that
    uses them needs the usual ``if __name__ == "__main__":``. Raises InputError if they cannot start.
    """
    waiting = iter(items)
    suspects: list[_Item] = []
    while batch := list(islice(waiting, AHEAD * workers)):
        suspects += yield from _until_a_death(function, batch, waiting, workers)
    waiting = iter(suspects)
    while alone := list(islice(waiting, 1)):
        for item in (yield from _until_a_death(function, alone, waiting, 1)):
            yield died(item)


def _until_a_death(
    function: Callable[[_Item], _Result], first: Sequence[_Item], waiting: Iterator[_Item], workers: int
) -> Generator[_Result, None, list[_Item]]:
    """Process the ``first`` items and, as they finish, those ``waiting``; returns the suspects when a process dies.

    At most ``len(first)`` items are in progress at a time, so with one there is no doubt which caused it.
    """
    lost: list[_Item] = []
    with _pool(workers) as pool:
        running = {_submit(pool, function, item): item for item in first}
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                item = running.pop(future)
                try:
                    yield future.result()
                except BrokenProcessPool:
                    lost.append(item)
                for following in islice(waiting, 0 if lost else 1):
                    running[_submit(pool, function, following)] = following
    return lost


def _submit(pool: ProcessPoolExecutor, function: Callable[[_Item], _Result], item: _Item) -> Future[_Result]:
    try:
        with interrupts_ignored():  # processes start here
            return pool.submit(function, item)
    except BrokenProcessPool as error:
        future: Future[_Result] = Future()
        future.set_exception(error)
        return future


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool that is known to start, and that begins no further item if the block ends early."""
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=be_a_worker)
    try:
        with interrupts_ignored():
            first = pool.submit(os.getpid)
        first.result()
        yield pool
    except BrokenProcessPool:
        raise InputError(
            "worker processes end as soon as they begin; in a script, put the call under if __name__ == '__main__':"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)
