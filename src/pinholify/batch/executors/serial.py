"""Execution in this process, one job after another."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from pinholify.batch.jobs import Job, Outcome
from pinholify.errors import ImageError

Work = Callable[[Job], None]
"""Does a job; an ImageError is a failure of that job, any other error ends the run."""


def in_series(work: Work, jobs: Sequence[Job], where: str = "") -> Iterator[Outcome]:
    """The outcomes of ``jobs`` in order."""
    return (attempt(work, job) for job in jobs)


def attempt(work: Work, job: Job) -> Outcome:
    """The outcome of one job."""
    try:
        work(job)
    except ImageError as error:
        return Outcome(job, str(error))
    return Outcome(job)
