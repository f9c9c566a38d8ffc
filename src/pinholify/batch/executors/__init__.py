"""Executors of jobs. Each yields every job's outcome once, in any order, even if workers die."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from pinholify.batch.executors.cluster import DaskCluster as DaskCluster
from pinholify.batch.executors.processes import Processes as Processes
from pinholify.batch.executors.serial import Serial as Serial
from pinholify.batch.executors.serial import Work as Work
from pinholify.batch.jobs import Job, Outcome

Executor = Callable[[Work, Sequence[Job]], Iterator[Outcome]]


def executor_for(workers: int, scheduler: str | None) -> Executor:
    """The cluster of a ``scheduler`` at that address, otherwise ``workers`` processes; for 1 it is this process."""
    if scheduler is not None:
        return DaskCluster(scheduler)
    return Serial() if workers == 1 else Processes(workers)
