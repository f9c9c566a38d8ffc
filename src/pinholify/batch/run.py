"""Straightening many pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path

from pinholify.batch.executors import executor_for
from pinholify.batch.jobs import BatchReport, Outcome, Plan, jobs_for, plan, report
from pinholify.batch.straightening import straightening
from pinholify.io import places
from pinholify.io.files import check_writable, make_folder
from pinholify.rectification.straightener import Straightener


def straighten_images(
    straightener: Straightener,
    sources: Sequence[str],
    folder: str,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    resume: bool = False,
    force: bool = False,
    on_outcome: Callable[[Outcome], object] | None = None,
) -> BatchReport:
    """Straighten the image files ``sources`` into ``folder``, as JPEG for a JPEG and otherwise as PNG.

    Sources and folder are paths or fsspec URLs. The work is done by ``workers`` processes of this machine (1: this
    process), or by the workers of the dask ``scheduler`` at that address. Every picture carries a stamp of its camera,
    view, options and source; with ``resume`` existing pictures with the right stamp are finished, and with ``force``
    others are replaced. ``on_outcome`` is called with the outcome of each job, those of finished ones first.

    A source that cannot be straightened is a failure in the report. Raises InputError or OutputError before any work if
    targets clash, exist or cannot be written, and OutputError if writing fails later.
    """
    work = straightening(straightener, again=force and not resume)
    jobs = jobs_for(sources, folder)
    planned = plan(jobs, work.standing(jobs), resume=resume, force=force)
    _make_room(folder, planned)
    outcomes: list[Outcome] = []
    ended = executor_for(workers, scheduler)(work, planned.to_do) if planned.to_do else ()
    for outcome in chain(map(Outcome, planned.finished), ended):
        outcomes.append(outcome)
        if on_outcome is not None:
            on_outcome(outcome)
    return report(planned, outcomes)


def _make_room(folder: str, planned: Plan) -> None:
    """Create the folder and check that the targets can be written; URLs can only be checked by writing."""
    if places.is_url(folder):
        return
    make_folder(Path(folder))
    for job in planned.to_do:
        check_writable(job.target)
