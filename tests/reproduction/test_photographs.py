"""Rendered photographs: finished ones are taken up again, unfinished ones are not."""

from dataclasses import replace

import pytest

from pinholify.io.images import read_image
from pinholify.reproduction.photographs import RECORD, photograph_files, render_photographs, rendered_before
from pinholify.reproduction.run import quick_version
from pinholify.simulation.datasets import DATASETS, reduced

SMALL = reduced(DATASETS["webcam"], 8.0)


def test_an_interrupted_rendering_leaves_no_record(tmp_path):
    files = photograph_files(SMALL, 2, tmp_path)

    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_photographs(SMALL, files, interrupt)
    assert not rendered_before(SMALL, files)
    render_photographs(SMALL, files, lambda: None)
    assert rendered_before(SMALL, files)
    with pytest.raises(KeyboardInterrupt):  # another recipe's photographs in part
        render_photographs(replace(SMALL, seed=5), files, interrupt)
    assert not rendered_before(SMALL, files)


def test_photographs_that_are_gone_or_unrecorded_are_rendered_anew(tmp_path):
    files = photograph_files(SMALL, 1, tmp_path)
    render_photographs(SMALL, files, lambda: None)
    record = files[0].parent / RECORD
    kept = record.read_text()
    record.write_text("[]")
    assert not rendered_before(SMALL, files)
    record.write_text(kept)
    assert rendered_before(SMALL, files)
    files[0].unlink()
    assert not rendered_before(SMALL, files)


def test_photographs_are_the_data_sets_own_and_lossless(tmp_path):
    files = photograph_files(SMALL, 1, tmp_path)
    render_photographs(SMALL, files, lambda: None)
    assert [p.name for p in files] == ["webcam-00.png"]
    assert (read_image(files[0]) == next(SMALL.photographs(1)).image).all()


def test_another_recipe_is_rendered_anew(tmp_path):
    files = photograph_files(SMALL, 1, tmp_path)
    render_photographs(SMALL, files, lambda: None)
    assert rendered_before(SMALL, files)
    assert not rendered_before(replace(SMALL, seed=5), files)


def test_quick_versions_are_no_larger_than_the_originals():
    for dataset in DATASETS.values():
        quick = quick_version(dataset)
        assert quick.lens.size[0] == min(1280, dataset.lens.size[0])
        assert quick.lens.size != dataset.lens.size or dataset.name == "mirror"
