"""One job after the other, in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from pinholify.batch.jobs import Job, Outcome
from pinholify.errors import ImageError

Work = Callable[[Job], None]
"""Does a job; an ImageError is that job's failure, any other error the end of the run."""


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
