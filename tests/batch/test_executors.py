"""Every executor does every job once, whatever becomes of single jobs and workers."""

from __future__ import annotations

import collections
import os
import shutil
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from pinholify.batch.executors import DaskCluster, Processes, Serial, executor_for
from pinholify.batch.executors import cluster as dask_executor
from pinholify.batch.jobs import Job, Outcome
from pinholify.batch.run import straighten_images
from pinholify.batch.straightening import Straightening, straightening
from pinholify.errors import ImageError, InputError, OutputError


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes on this machine."""
    distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as started:
        yield started


@pytest.fixture(params=["serial", "processes", "dask"])
def executor(request):
    if request.param == "dask":
        return DaskCluster(request.getfixturevalue("cluster").scheduler_address)
    return {"serial": Serial(), "processes": Processes(2)}[request.param]


@dataclass(frozen=True)
class Chores:
    """Writes a line into the target for every time a job is done; some sources go wrong."""

    def __call__(self, job: Job) -> None:
        if "bad" in job.source:
            raise ImageError(f"'{job.source}' is bad")
        if "full" in job.source:
            raise OutputError("the disk is full")
        with open(job.target, "a") as file:
            file.write("done\n")
        if "deadly" in job.source:
            os.kill(os.getpid(), signal.SIGKILL)


def jobs_of(folder: Path, *names: str) -> list[Job]:
    return [Job(name, str(folder / name)) for name in names]


def test_every_job_is_done_once(executor, tmp_path):
    jobs = jobs_of(tmp_path, *(f"{i}" for i in range(20)))
    outcomes = list(executor(Chores(), jobs))
    assert sorted(outcomes, key=lambda o: jobs.index(o.job)) == [Outcome(job) for job in jobs]
    assert {Path(job.target).read_text() for job in jobs} == {"done\n"}


def test_a_failure_is_that_jobs_alone(executor, tmp_path):
    jobs = jobs_of(tmp_path, "a", "bad", "b")
    outcomes = {outcome.job: outcome.failure for outcome in executor(Chores(), jobs)}
    assert list(map(outcomes.get, jobs))[::2] == ["", ""]
    assert outcomes[jobs[1]].endswith("bad' is bad")


def test_another_error_ends_the_run(executor, tmp_path):
    with pytest.raises(OutputError, match="the disk is full"):
        list(executor(Chores(), jobs_of(tmp_path, "a", "full", "b")))


@pytest.mark.slow
def test_a_job_that_kills_its_process_is_found_out(tmp_path):
    jobs = jobs_of(tmp_path, "a", "b", "deadly", *(f"{i}" for i in range(8)))
    outcomes = {outcome.job: outcome.failure for outcome in Processes(2)(Chores(), jobs)}
    assert len(outcomes) == len(jobs)
    assert [job.source for job, failure in outcomes.items() if failure] == ["deadly"]
    assert "died twice" in outcomes[jobs[2]]


def test_the_place_of_work_is_chosen():
    assert executor_for(1, None) == Serial()
    assert executor_for(3, None) == Processes(3)
    assert executor_for(1, "tcp://here:1") == DaskCluster("tcp://here:1")


def test_processes_that_cannot_start(tmp_path, monkeypatch):
    monkeypatch.setattr("pinholify.io.processes.be_a_worker", os.abort)
    with pytest.raises(InputError, match="__main__"):
        list(Processes(1)(Chores(), jobs_of(tmp_path, "a")))


def test_no_scheduler(tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    monkeypatch.setattr("pinholify.batch.executors.cluster.PATIENCE", 0.5)
    with pytest.raises(InputError, match="no scheduler answers at"):
        list(DaskCluster("tcp://127.0.0.1:9")(Chores(), jobs_of(tmp_path, "a")))


def test_without_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'pinholify\[cluster\]'"):
        list(DaskCluster("tcp://127.0.0.1:9")(Chores(), jobs_of(tmp_path, "a")))


@pytest.mark.parametrize("where", ["serial", "processes", "dask"])
def test_a_run_that_is_stopped_goes_on(straightener, pictures, tmp_path, where, request):
    options = {"serial": {}, "processes": {"workers": 2}}.get(where)
    if options is None:
        options = {"scheduler": request.getfixturevalue("cluster").scheduler_address}
    out = str(tmp_path / "out")

    class Stop(Exception):
        pass

    seen = []

    def stop_at_the_fourth(outcome):
        seen.append(outcome)
        if len(seen) == 4:
            raise Stop

    with pytest.raises(Stop):
        straighten_images(straightener, pictures, out, on_outcome=stop_at_the_fourth, **options)
    # One that a worker is still at when the run is stopped is hidden, until it is renamed into its place.
    done = {path: path.stat().st_ino for path in Path(out).glob("[!.]*")}
    assert 4 <= len(done) <= len(pictures)
    with pytest.raises(OutputError, match="use --resume"):
        straighten_images(straightener, pictures, out, **options)
    report = straighten_images(straightener, pictures, out, resume=True, **options)
    assert len(report.finished) >= len(done)
    assert len(report.finished) + len(report.written) == len(pictures)
    assert {path: path.stat().st_ino for path in done} == done
    assert straighten_images(straightener, pictures, out, resume=True, **options).written == ()


@dataclass(frozen=True, eq=False)
class Logged:
    """Notes every picture that is really written."""

    work: Straightening
    log: str

    def __call__(self, job: Job) -> None:
        before = number(job.target)
        self.work(job)
        if number(job.target) != before:
            with open(self.log, "a") as file:
                file.write(job.target + "\n")


def number(path: str) -> int | None:
    """Which file it is: another one after every atomic write."""
    return os.stat(path).st_ino if os.path.exists(path) else None


@pytest.mark.slow
def test_500_pictures_on_a_cluster_that_loses_a_worker(cluster, straightener, pictures, tmp_path):
    sources = [str(tmp_path / "in" / f"p{i}.png") for i in range(500)]
    for i, source in enumerate(sources):
        shutil.copy(pictures[i % len(pictures)], source)
    (tmp_path / "out").mkdir()
    jobs = [Job(source, str(tmp_path / "out" / Path(source).name)) for source in sources]
    work = Logged(straightening(straightener), str(tmp_path / "log"))
    pid = next(iter(cluster.workers.values())).pid
    outcomes = list(killing(DaskCluster(cluster.scheduler_address)(work, jobs), after=100, pid=pid))
    assert [o.failure for o in outcomes] == [""] * 500
    assert {o.job for o in outcomes} == set(jobs)
    assert work.work.standing(jobs) == {job.target: True for job in jobs}
    written = collections.Counter((tmp_path / "log").read_text().split())
    assert set(written.values()) == {1}
    assert len(written) >= 499  # one may have been killed after it wrote and before it noted so


def killing(outcomes: Iterator[Outcome], *, after: int, pid: int) -> Iterator[Outcome]:
    for count, outcome in enumerate(outcomes):
        if count == after:
            os.kill(pid, signal.SIGKILL)
        yield outcome


def test_an_answer_lost_with_its_worker_is_asked_for_again(monkeypatch):
    distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    monkeypatch.setattr(dask_executor, "PAUSE", 0.0)
    job = Job("in.png", "out.png")
    answers = iter([distributed.comm.CommClosedError("its worker died"), Outcome(job, "")])

    class Future:
        status = "finished"

        def result(self):
            answer = next(answers)
            if isinstance(answer, Exception):
                raise answer
            return answer

    assert dask_executor._outcome(distributed, Future(), job) == Outcome(job, "")
