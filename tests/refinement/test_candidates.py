"""What trends are compared by."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pinholify.refinement.candidates import Candidate
from pinholify.refinement.evidence import Hyperparameters

ROWS = 2700  # coordinates of ten boards' corners


def candidate(noise: float, *, ends_in_image: bool) -> Candidate:
    """One whose residuals are all noise, so that its evidence goes with the noise alone."""
    problem: Any = SimpleNamespace(rows=ROWS)
    trend: Any = SimpleNamespace(name="any")
    found = Hyperparameters(np.zeros(0), noise)
    return Candidate(trend, found, -ROWS * np.log(noise), problem, trend, ends_in_image)


@pytest.mark.parametrize("noise", [0.01, 0.1, 1.0])
def test_a_trend_that_ends_in_the_image_has_to_leave_a_fifth_less_noise(noise: float) -> None:
    whole = candidate(noise, ends_in_image=False)
    assert candidate(0.85 * noise, ends_in_image=True).score < whole.score
    assert candidate(0.75 * noise, ends_in_image=True).score > whole.score
