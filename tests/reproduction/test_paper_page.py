"""docs/paper.md names only what exists, and the paper's figures are copied right."""

import importlib
import re
from pathlib import Path

import pytest

from pinholify.reproduction.paper import REPORTED
from pinholify.simulation.datasets import DATASETS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "paper.md"
NAMES = sorted(set(re.findall(r"`(pinholify\.[\w.]+)`", PAGE.read_text(encoding="utf-8"))))


def found(name):
    """Whether a dotted name leads to a module, a class, a function or a member of a class."""
    parts = name.split(".")
    for split in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:split]))
        except ModuleNotFoundError:
            continue
        for part in parts[split:]:
            if not hasattr(thing, part):
                return False
            thing = getattr(thing, part)
        return True
    return False


@pytest.mark.parametrize("name", NAMES)
def test_every_function_that_the_page_names_exists(name):
    assert found(name)


def test_a_name_that_does_not_exist_is_seen():
    assert len(NAMES) > 30
    assert not found("pinholify.gp.regression.GaussianProcess.median")
    assert not found("pinholify.geometrie")


def test_every_equation_of_the_paper_is_there():
    numbers = set()
    for cell in re.findall(r"^\| ([\d, ]+) \|", PAGE.read_text(encoding="utf-8"), flags=re.M):
        numbers |= {int(n) for n in cell.split(",")}
    assert numbers == set(range(1, 23))


def test_the_data_sets_have_the_papers_boards_corners_and_sizes():
    assert list(REPORTED) == list(DATASETS)
    for name, said in REPORTED.items():
        dataset = DATASETS[name]
        assert (dataset.views, dataset.board.spec, dataset.lens.size) == (said.boards, said.corners, said.size)


def test_reported_figures_are_those_of_the_papers_source():
    source = ROOT / "../shared/paper.tex"
    if not source.exists():
        pytest.skip("the paper's source is not beside the project")
    text = source.read_text(encoding="utf-8")
    rows = re.findall(r"& *([\d.]+) *& *([\d.]+) *& *([\d.]+) *\\\\", text[text.index("GP CE $(") :])
    said = [(f"{r.ce * 1e4:.3f}", f"{r.re:.4f}", f"{r.matlab_re:.4f}") for r in REPORTED.values()]
    assert rows == said
