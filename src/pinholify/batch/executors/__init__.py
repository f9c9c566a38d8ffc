"""Executors of jobs. Each yields every job's outcome once, in any order, even if workers die."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from pinholify.batch.executors.cluster import on_cluster
from pinholify.batch.executors.processes import in_processes
from pinholify.batch.executors.serial import Work as Work
from pinholify.batch.executors.serial import in_series
from pinholify.batch.jobs import Job, Outcome

Executor = Callable[[Work, Sequence[Job], str], Iterator[Outcome]]
"""The last argument is the place of work: ignored, a number of processes, or the address of a scheduler."""

EXECUTORS: dict[str, Executor] = {
    "serial": in_series,
    "processes": in_processes,
    "dask": on_cluster,
}
