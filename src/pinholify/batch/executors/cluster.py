"""Execution on a dask cluster (extra ``cluster``). The scheduler gives a dead worker's jobs to the others."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import Any

from pinholify.batch.executors.serial import Work, attempt
from pinholify.batch.jobs import Job, Outcome
from pinholify.errors import InputError, OutputError
from pinholify.io.places import absolute

PATIENCE = 10.0
"""Seconds to wait for a scheduler."""
GONE = "the scheduler stopped before all jobs were done; run the same command with --resume to do the rest"
ATTEMPTS, PAUSE = 10, 0.5
"""How often a result is requested, and the seconds between."""


@dataclass(frozen=True, slots=True)
class DaskCluster:
    """Does jobs on the workers of the scheduler at ``address``, e.g. tcp://127.0.0.1:8786."""

    address: str

    def __call__(self, work: Work, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """The outcomes of ``jobs`` as they end.

        Raises InputError if no scheduler answers, OutputError if it stops before the jobs have ended.
        """
        distributed = _distributed()
        with _connected(distributed, self.address) as client:
            # The work is a task as well: jobs share its result, and it is recomputed if the worker that holds it dies.
            shared = client.submit(_itself, work, pure=False)
            futures = client.map(attempt, [shared] * len(jobs), [_elsewhere(job) for job in jobs], pure=False)
            job_of = {future.key: job for future, job in zip(futures, jobs, strict=True)}
            for future in distributed.as_completed(futures, loop=client.loop):
                yield _outcome(distributed, future, job_of[future.key])


def _itself(work: Work) -> Work:
    return work


def _elsewhere(job: Job) -> Job:
    """``job`` with absolute paths, for workers with another working folder."""
    return Job(absolute(job.source), absolute(job.target))


def _distributed() -> Any:
    """The package ``distributed``, which has no type hints."""
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise InputError("--scheduler needs dask, which is not installed: pip install 'pinholify[cluster]'") from None


def _connected(distributed: Any, address: str) -> Any:
    try:
        return distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError):
        raise InputError(
            f"no scheduler answers at '{address}'; start one with 'dask scheduler' and give the address it prints"
        ) from None


def _outcome(distributed: Any, future: Any, job: Job) -> Outcome:
    # A "lost" result died with its worker and is recomputed by others; "cancelled" means that the scheduler stopped.
    if future.status == "cancelled":
        raise OutputError(GONE)
    try:
        return Outcome(job, _result(distributed, future).failure)
    except distributed.KilledWorker:
        return Outcome(job, f"'{job.source}': several workers died of it, perhaps for lack of memory")
    except CancelledError:
        raise OutputError(GONE) from None


def _result(distributed: Any, future: Any) -> Any:
    """The result of ``future``, requested again if a worker dies while sending it, since others repeat its job."""
    for _ in range(ATTEMPTS):
        try:
            return future.result()
        except distributed.comm.CommClosedError:
            time.sleep(PAUSE)
    raise OutputError("the cluster's workers keep dying; run the same command with --resume to do the rest")
