"""How noisy each board is, from samples of boards whose noise is known."""

import numpy as np
import pytest

from pinholify.refinement.trust import MEDIAN_LOG_VARIANCE, _hierarchy


def test_the_variance_of_a_log_variance_by_the_median() -> None:
    """Of residuals (n, 2) of unit normals, whose squared length has the median 2 log 2."""
    squared = (np.random.default_rng(0).normal(size=(4000, 60, 2)) ** 2).sum(axis=2)
    found = np.log(np.median(squared, axis=1) / (2.0 * np.log(2.0)))
    assert found.var() == pytest.approx(MEDIAN_LOG_VARIANCE / 120, rel=0.1)


@pytest.mark.parametrize("spread", [0.25, 1.0])
def test_boards_that_differ_tell_how_much(spread: float) -> None:
    rng = np.random.default_rng(1)
    chance = rng.uniform(0.02, 0.08, 4000)
    found = rng.normal(-3.0, np.sqrt(spread + chance))
    typical, variance = _hierarchy(found, chance)
    assert typical == pytest.approx(-3.0, abs=0.05)
    assert variance == pytest.approx(spread, rel=0.1)


def test_boards_alike_do_not_differ() -> None:
    rng, chance = np.random.default_rng(2), np.full(14, 0.04)
    variances = [_hierarchy(rng.normal(0.0, 0.2, 14), chance)[1] for _ in range(400)]
    assert np.mean(np.array(variances) > 0.0) < 0.02
    assert _hierarchy(np.array([1.0]), np.array([0.04])) == (0.0, 0.0)
