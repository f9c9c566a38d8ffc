"""Several processes of this machine. Where one dies, the jobs it may have died of are tried again, each by itself."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice

from pinholify.batch.executors.serial import Work, attempt
from pinholify.batch.jobs import Job, Outcome
from pinholify.errors import InputError
from pinholify.io.processes import be_a_worker, interrupts_ignored

AHEAD = 2
"""Jobs given out to each process: one it does, one that waits for it."""


def in_processes(work: Work, jobs: Sequence[Job], where: str) -> Iterator[Outcome]:
    """The outcomes of ``jobs``, done by ``where`` processes.

    Processes are spawned, so a script that asks for them needs the usual ``if __name__ == "__main__":``; InputError
    where they cannot start.
    """
    workers = min(int(where), len(jobs))
    waiting = iter(jobs)
    suspects: list[Job] = []
    while batch := list(islice(waiting, AHEAD * workers)):
        suspects += yield from _until_a_death(work, batch, waiting, workers)
    waiting = iter(suspects)
    while alone := list(islice(waiting, 1)):
        for job in (yield from _until_a_death(work, alone, waiting, 1)):
            yield Outcome(job, f"'{job.source}': the process that worked on it died, twice; perhaps for want of memory")


def _until_a_death(
    work: Work, first: Sequence[Job], waiting: Iterator[Job], workers: int
) -> Generator[Outcome, None, list[Job]]:
    """Do the ``first`` jobs and, as they end, those that are ``waiting``. When a process dies: the jobs it may be for.

    No more than the ``first`` are given out at a time, so of one there is no doubt.
    """
    lost: list[Job] = []
    with _pool(workers) as pool:
        running = {_submit(pool, work, job): job for job in first}
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                job = running.pop(future)
                try:
                    yield future.result()
                except BrokenProcessPool:
                    lost.append(job)
                for following in islice(waiting, 0 if lost else 1):
                    running[_submit(pool, work, following)] = following
    return lost


def _submit(pool: ProcessPoolExecutor, work: Work, job: Job) -> Future[Outcome]:
    try:
        with interrupts_ignored():  # this is when processes start
            return pool.submit(attempt, work, job)
    except BrokenProcessPool as error:
        future: Future[Outcome] = Future()
        future.set_exception(error)
        return future


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that do start, and that do not begin another job when the block ends early."""
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
