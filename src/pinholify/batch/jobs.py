"""Jobs, plans and reports of a batch, computed without reading files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pinholify.errors import InputError, OutputError
from pinholify.io.places import inside, name_of, real

JPEG = (".jpg", ".jpeg")


@dataclass(frozen=True, slots=True)
class Job:
    """One picture: read at ``source`` and written to ``target``, paths or URLs."""

    source: str
    target: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """A job that has ended: ``failure`` is one sentence, empty if the target was written."""

    job: Job
    failure: str = ""


@dataclass(frozen=True, slots=True)
class Plan:
    """The jobs ``to_do``, and those that an earlier run ``finished``."""

    to_do: tuple[Job, ...]
    finished: tuple[Job, ...]


@dataclass(frozen=True, slots=True)
class BatchReport:
    """The result of a run: ``written`` targets in the order of the sources, those ``finished`` earlier, failures."""

    written: tuple[str, ...]
    finished: tuple[str, ...]
    failed: Mapping[str, str]
    """Source → one sentence."""


def jobs_for(sources: Sequence[str], folder: str) -> tuple[Job, ...]:
    """One job per source: into ``folder`` with the same stem, as JPEG for a JPEG, otherwise as PNG.

    Raises InputError if two sources have the same target, OutputError if a source would be overwritten.
    """
    jobs = tuple(Job(source, inside(folder, _target_name(source))) for source in sources)
    twice = [target for target, count in Counter(job.target for job in jobs).items() if count > 1]
    if twice:
        raise InputError(f"two images would both be written as '{twice[0]}'; rename one, or use two runs")
    if {real(job.target) for job in jobs} & {real(source) for source in sources}:
        raise OutputError("the results would replace the photographs themselves; choose another folder with -o")
    return jobs


def _target_name(source: str) -> str:
    name = Path(name_of(source))
    return name.stem + (name.suffix if name.suffix.lower() in JPEG else ".png")


def plan(jobs: Sequence[Job], standing: Mapping[str, bool], *, resume: bool = False, force: bool = False) -> Plan:
    """Which of ``jobs`` to do; ``standing`` has a key for every existing target: whether this work wrote it.

    With ``resume`` the targets that this work wrote are finished; with ``force`` all others are replaced. Raises
    OutputError for any other existing target.
    """
    finished = {job for job in jobs if resume and standing.get(job.target)}
    left = tuple(job for job in jobs if job not in finished)
    in_the_way = [job.target for job in left if job.target in standing]
    if in_the_way and not force:
        raise OutputError(_in_the_way(in_the_way, resume, any(standing[target] for target in in_the_way)))
    return Plan(left, tuple(job for job in jobs if job in finished))


def _in_the_way(targets: Sequence[str], resume: bool, ours: bool) -> str:
    found = f"'{targets[0]}' is already there ({len(targets)} in all)"
    if resume:
        found += " and does not come from this photograph, camera and view"
    return f"{found}; choose another folder, {'use --resume to do only the rest, ' if ours else ''}or use --force"


def report(plan: Plan, outcomes: Sequence[Outcome]) -> BatchReport:
    """The report of ``outcomes``, which may be in any order."""
    failures = {outcome.job: outcome.failure for outcome in outcomes}
    return BatchReport(
        tuple(job.target for job in plan.to_do if not failures[job]),
        tuple(job.target for job in plan.finished),
        {job.source: failures[job] for job in plan.to_do if failures[job]},
    )
