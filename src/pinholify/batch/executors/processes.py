"""Execution in several processes of this machine. If one dies, the jobs it may have died of are retried one by one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from pinholify.batch.executors.serial import Work, attempt
from pinholify.batch.jobs import Job, Outcome
from pinholify.io.processes import DIED, in_processes


@dataclass(frozen=True, slots=True)
class Processes:
    """Does jobs in ``workers`` processes; see :func:`pinholify.io.processes.in_processes`."""

    workers: int

    def __call__(self, work: Work, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """The outcomes of ``jobs`` as they end; raises InputError if the processes cannot start."""
        return in_processes(partial(attempt, work), jobs, min(self.workers, len(jobs)), died=_died)


def _died(job: Job) -> Outcome:
    return Outcome(job, f"'{job.source}': {DIED}")
