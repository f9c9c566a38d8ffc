"""A reproduction of two tiny data sets, run once: the barrel lens and the mirror."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pinholify.reproduction.run import reproduce
from pinholify.simulation.datasets import DATASETS, reduced


def tiny(name, width, views):
    """The data set of that name in small images of few boards."""
    dataset = DATASETS[name]
    return replace(reduced(dataset, dataset.lens.size[0] / width), views=views)


@pytest.fixture(scope="session")
def datasets():
    return [tiny("unity-barrel", 800, 6), tiny("mirror", 640, 6)]


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("reproduction")


@pytest.fixture(scope="session")
def reproduction(folder, datasets):
    return reproduce(folder, datasets=datasets)
