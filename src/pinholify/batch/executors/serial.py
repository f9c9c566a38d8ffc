"""Execution in this process, one job after another."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from pinholify.batch.jobs import Job, Outcome
from pinholify.errors import ImageError

Work = Callable[[Job], None]
"""Does a job; an ImageError is a failure of that job, any other error ends the run."""


@dataclass(frozen=True, slots=True)
class Serial:
    """Does jobs in this process."""

    def __call__(self, work: Work, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """The outcomes of ``jobs`` in order."""
        return (attempt(work, job) for job in jobs)


def attempt(work: Work, job: Job) -> Outcome:
    """The outcome of one job."""
    try:
        work(job)
    except ImageError as error:
        return Outcome(job, str(error))
    return Outcome(job)
