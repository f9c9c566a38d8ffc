"""Corners of an image as a value."""

import numpy as np
import pytest

from pinholify.corners import Corners

IDS, UV = np.arange(3), np.zeros((3, 2))


def test_weights_are_one_unless_given_and_one_number_is_that_of_every_corner():
    np.testing.assert_array_equal(Corners("a", IDS, UV).weights, [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(Corners("a", IDS, UV, np.array(0.5)).weights, [0.5, 0.5, 0.5])
    np.testing.assert_array_equal(Corners("a", IDS, UV, [0.1, 0.2, 0.3]).weights, [0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match="shape"):
        Corners("a", IDS, UV, [1.0, 1.0])
    for weights in (None, [1.0, np.nan, 1.0]):
        with pytest.raises(ValueError, match="weights, are not finite"):
            Corners("a", IDS, UV, weights)
