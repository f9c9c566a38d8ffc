"""Execution in several processes of this machine. If one dies, the jobs it may have died of are retried one by one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from pinholify.batch.executors.serial import Work, attempt
from pinholify.batch.jobs import Job, Outcome
from pinholify.io import processes


def in_processes(work: Work, jobs: Sequence[Job], where: str) -> Iterator[Outcome]:
    """The outcomes of ``jobs``, done by ``where`` processes; see :func:`pinholify.io.processes.in_processes`."""
    workers = min(int(where), len(jobs))
    return processes.in_processes(partial(attempt, work), jobs, workers, died=_died)


def _died(job: Job) -> Outcome:
    return Outcome(job, f"'{job.source}': {processes.DIED}")
