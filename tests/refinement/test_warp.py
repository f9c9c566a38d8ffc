"""How large a board's warp is, against the evidence computed directly."""

from dataclasses import replace

import numpy as np
import pytest

from pinholify.refinement import joint
from pinholify.refinement.evidence import posterior
from pinholify.refinement.shape import WARP, BoardShape
from pinholify.refinement.warp import STD_RANGE, refitted

from .conftest import BOARD, cockled, make_scene


def refits(monkeypatch: pytest.MonkeyPatch, warp: np.ndarray) -> list[tuple]:
    """What the refinement of boards with this ``warp`` asks, and is told."""
    asked = []

    def told(shape, problem, density, hyperparameters):
        found = refitted(shape, problem, density, hyperparameters)
        asked.append((shape, problem, density, hyperparameters, found))
        return found

    monkeypatch.setattr("pinholify.refinement.settle.refitted", told)
    joint.refine(make_scene("pinhole", views=14, warp=warp, seed=1).corners, reference="view00")
    return asked


def log_evidence(shape: BoardShape, problem, density, hyperparameters) -> float:
    """With the process not averaged over but a part of the problem."""
    rest = np.array(problem.precision)
    rest[len(rest) - len(shape.part) :] = shape.prior_std**-2.0
    precision = hyperparameters.precision(density, problem.frequencies, rest)
    return posterior(replace(problem, precision=rest), precision, hyperparameters.noise).log_evidence


def test_no_other_size_has_more_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    shape, problem, density, hyperparameters, found = refits(monkeypatch, cockled(0.004, seed=1))[-1]
    sizes = found.shape.prior_std[found.shape.part == WARP][[0, -1]]
    best = log_evidence(found.shape, problem, density, hyperparameters)
    for factors in ((1.2, 1.0), (0.8, 1.0), (1.0, 1.2), (1.0, 0.8)):
        assert log_evidence(shape.warped(*(sizes * factors)), problem, density, hyperparameters) < best + 0.02
    none = log_evidence(shape.warped(1e-9, 1e-9), problem, density, hyperparameters)
    assert found.gain == pytest.approx(best - none, abs=0.01)
    assert sizes[0] == pytest.approx(0.004, rel=0.5)


def test_a_board_bent_more_than_any_prior_expects(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search starts where the last one ended, at the end of its range."""
    bend = np.column_stack([np.zeros((54, 2)), 0.4 * np.sin(np.arange(54) % BOARD.columns * 0.8)])
    sizes = [found.shape.prior_std[-1] for *_, found in refits(monkeypatch, bend)]
    assert max(sizes) == pytest.approx(STD_RANGE[1])
