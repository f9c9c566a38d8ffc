import numpy as np
import pytest

from pinholify.detection.growth import bounded, disorder, regular
from pinholify.detection.lattice import Lattice

SIDE = 20


def squares(columns=6, rows=5):
    """A picture of squares of SIDE px, the one at its top left bright, and its lattice."""
    v, u = np.mgrid[0 : (rows + 1) * SIDE, 0 : (columns + 1) * SIDE]
    grey = np.where((u // SIDE + v // SIDE) % 2 == 0, 200.0, 40.0).astype(np.float32)
    index = np.array([(i, j) for j in range(rows) for i in range(columns)])
    return grey, Lattice(index, (index + 1) * SIDE - 0.5, np.ones(len(index)), 1)


def test_corners_of_squares_stand_at_the_ends_of_edges():
    grey, lattice = squares()
    assert bounded(grey, lattice).all()


def test_other_colours_or_none_make_no_edges():
    grey, lattice = squares()
    assert not bounded(240 - grey, lattice).any()
    assert not bounded(np.full_like(grey, 90), lattice).any()


def test_one_corner_out_of_place_is_found_and_only_that_one():
    _, lattice = squares()
    uv = np.array(lattice.uv)
    uv[14] += [0.3 * SIDE, -0.2 * SIDE]
    kept = regular(Lattice(lattice.index, uv, lattice.weights, 1))
    assert np.flatnonzero(~kept).tolist() == [14]


@pytest.mark.parametrize(("scatter", "orderly"), [(0.01, True), (0.3, False)])
def test_disorder_tells_a_lattice_from_a_crowd(scatter, orderly):
    _, lattice = squares()
    uv = lattice.uv + np.random.default_rng(0).normal(0, scatter * SIDE, lattice.uv.shape)
    assert (disorder(Lattice(lattice.index, uv, lattice.weights, 1)) < 0.1) == orderly
