"""Worker processes: how they start, what becomes of their work where one dies, and that Ctrl-C is their parent's."""

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
"""Items given out to each process: one it works on, one that waits for it."""

DIED = "the process that worked on it died, twice; perhaps for want of memory"

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """No Ctrl-C inside; only a program's main thread can say so, others change nothing.

    Processes that are started inside inherit it: while they start, Ctrl-C is for the parent alone.
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
    """One thread a process, and Ctrl-C left to the parent, which ends the pool."""
    one_blas_thread()
    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)


def in_processes(
    function: Callable[[_Item], _Result], items: Sequence[_Item], workers: int, *, died: Callable[[_Item], _Result]
) -> Iterator[_Result]:
    """``function`` of each of ``items``, in the order in which they end, done by so many ``workers``.

    Where a process dies, the items it may have died of are tried again, each by itself; ``died`` is the result of one
    that ends its process again. Processes are spawned (a fork after OpenCV has run threads can hang), so a script that
    asks for them needs the usual ``if __name__ == "__main__":``; InputError where they cannot start.
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
    """Work on the ``first`` items and, as they end, those ``waiting``. When a process dies: the items it may be for.

    No more than the ``first`` are given out at a time, so of one there is no doubt.
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
        with interrupts_ignored():  # this is when processes start
            return pool.submit(function, item)
    except BrokenProcessPool as error:
        future: Future[_Result] = Future()
        future.set_exception(error)
        return future


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that do start, and that do not begin another item when the block ends early."""
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
