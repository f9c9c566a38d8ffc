"""What is to be done: decided without touching a file."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinholify.batch.jobs import Job, Outcome, Plan, jobs_for, plan, report
from pinholify.errors import InputError, OutputError

JOBS = tuple(Job(f"in/{i}.png", f"out/{i}.png") for i in range(6))


@pytest.mark.parametrize(
    ("source", "folder", "target"),
    [
        ("a/b.png", "out", "out/b.png"),
        ("a/b.tiff", "out/", "out/b.png"),
        ("b.JPG", "out", "out/b.JPG"),
        ("b", "out", "out/b.png"),
        ("a/b.c.jpeg", "s3://bucket/straight/", "s3://bucket/straight/b.c.jpeg"),
        ("memory://x/b.bmp", "out", "out/b.png"),
    ],
)
def test_target(source, folder, target):
    assert jobs_for([source], folder) == (Job(source, target),)


def test_targets_that_clash():
    with pytest.raises(InputError, match="two images would both be written"):
        jobs_for(["a/b.tif", "c/b.png"], "out")


def test_targets_that_are_sources(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path)
    for folder in (tmp_path, tmp_path / "link"):
        with pytest.raises(OutputError, match="would replace the photographs"):
            jobs_for([str(tmp_path / "a.png")], str(folder))
    with pytest.raises(OutputError, match="would replace the photographs"):
        jobs_for(["s3://b/in/a.png"], "s3://b/in")


def test_nothing_stands():
    assert plan(JOBS, {}) == plan(JOBS, {}, resume=True) == plan(JOBS, {}, force=True) == Plan(JOBS, ())


def test_what_stands_is_refused_and_resume_is_offered_where_it_helps():
    with pytest.raises(OutputError, match=r"already there \(1 in all\).* --resume"):
        plan(JOBS, {JOBS[3].target: True})
    with pytest.raises(OutputError) as refused:
        plan(JOBS, {JOBS[3].target: False})
    assert "--resume" not in str(refused.value)
    with pytest.raises(OutputError, match="does not come from this photograph, camera and view"):
        plan(JOBS, {JOBS[3].target: False}, resume=True)


@given(st.dictionaries(st.sampled_from([job.target for job in JOBS]), st.booleans()), st.booleans())
def test_with_force_every_job_is_done_or_finished(standing, resume):
    made = plan(JOBS, standing, resume=resume, force=True)
    assert sorted(made.to_do + made.finished, key=JOBS.index) == list(JOBS)
    assert {job.target for job in made.finished} == {t for t, ours in standing.items() if ours and resume}


def test_report_keeps_the_order_of_the_sources():
    made = plan(JOBS, {JOBS[1].target: True}, resume=True)
    outcomes = [Outcome(job, "bad" if job is JOBS[2] else "") for job in reversed(made.to_do)]
    found = report(made, outcomes)
    assert found.written == ("out/0.png", "out/3.png", "out/4.png", "out/5.png")
    assert found.finished == ("out/1.png",)
    assert found.failed == {"in/2.png": "bad"}
