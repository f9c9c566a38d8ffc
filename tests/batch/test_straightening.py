"""One picture from place to place, and how one that is done is known."""

from __future__ import annotations

import dataclasses
import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from pinholify.batch.jobs import Job
from pinholify.batch.straightening import straightening
from pinholify.errors import ImageError
from pinholify.io.images import read_image, write_image
from pinholify.modes import cropped
from pinholify.rectification.maps import rectification_map
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.straightener import Straightener


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_picture_is_straightened_and_known_again(work, pictures, tmp_path, suffix):
    source, target = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    write_image(source, read_image(pictures[0]))
    job = Job(str(source), str(target))
    assert work.standing([job]) == {}
    work(job)
    plain = tmp_path / f"plain{suffix}"
    write_image(plain, work.straightener(read_image(source)))
    np.testing.assert_array_equal(read_image(target), read_image(plain))
    assert work.standing([job]) == {str(target): True}


def test_it_is_not_done_twice_but_again_where_that_is_asked(work, straightener, pictures, tmp_path):
    job = Job(pictures[0], str(tmp_path / "b.png"))
    work(job)
    first = os.stat(job.target).st_ino, os.stat(job.target).st_mtime_ns
    work(job)
    assert (os.stat(job.target).st_ino, os.stat(job.target).st_mtime_ns) == first
    straightening(straightener, again=True)(job)
    assert (os.stat(job.target).st_ino, os.stat(job.target).st_mtime_ns) != first


def other_works(straightener):
    camera = straightener.camera
    chart = dataclasses.replace(
        camera.chart, intrinsics=dataclasses.replace(camera.intrinsics, f=camera.intrinsics.f + 1e-9)
    )
    moved = dataclasses.replace(camera, chart=chart)
    yield Straightener(moved)
    yield Straightener(cropped(camera, 1, 0, (95, 72)))
    yield Straightener(camera, ViewOptions("board"))
    yield Straightener(camera, ViewOptions(size=(96, 71)))
    yield Straightener(camera, method="splat")
    yield Straightener(camera, ViewOptions(max_std=1.0))


def test_another_camera_view_or_photograph_is_noticed(work, straightener, pictures, tmp_path):
    job = Job(pictures[0], str(tmp_path / "b.png"))
    work(job)
    for other in other_works(straightener):
        assert straightening(other).standing([job]) == {job.target: False}
    assert work.standing([Job(pictures[1], job.target)]) == {job.target: False}
    write_image(pictures[0], np.zeros((72, 96), np.uint8))
    assert work.standing([job]) == {job.target: False}


def test_foreign_files_are_not_taken_for_done(work, pictures, tmp_path):
    target = tmp_path / "b.png"
    for content in (b"", b"mine\n", Path(pictures[0]).read_bytes()):
        target.write_bytes(content)
        assert work.standing([Job(pictures[0], str(target))]) == {str(target): False}
    target.unlink()
    target.mkdir()
    assert work.standing([Job(pictures[0], str(target))]) == {str(target): False}


def test_the_work_stays_small_and_the_same_elsewhere(work, straightener, pictures, tmp_path):
    before = len(pickle.dumps(work))
    work(Job(pictures[0], str(tmp_path / "b.png")))
    assert len(pickle.dumps(work)) == before
    copy = pickle.loads(pickle.dumps(work))
    assert copy.identity == work.identity == straightening(copy.straightener).identity
    straightener(read_image(pictures[0]))
    assert straightening(straightener).identity == work.identity


def test_a_process_builds_its_map_once_for_all_its_pictures(straightener, pictures, tmp_path, monkeypatch):
    """Every picture comes with a copy of the work."""
    built = []
    work = straightening(Straightener(straightener.camera, ViewOptions(size=(50, 40))))
    monkeypatch.setattr(
        "pinholify.rectification.straightener.rectification_map",
        lambda *given, **options: built.append(1) or rectification_map(*given, **options),
    )
    for number, source in enumerate(pictures[:3]):
        pickle.loads(pickle.dumps(work))(Job(source, str(tmp_path / f"{number}.png")))
    assert len(built) == 1


def test_a_photograph_of_another_camera_is_named(work, pictures, tmp_path):
    write_image(pictures[0], np.zeros((50, 50), np.uint8))
    with pytest.raises(ImageError, match=r"0\.png': the image is 50x50 and the camera was calibrated at 96x72"):
        work(Job(pictures[0], str(tmp_path / "b.png")))
