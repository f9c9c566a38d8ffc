"""The shared solver finds roots, and says NaN where there is none."""

import numpy as np

from pinholify.simulation.newton import smallest_positive, solve


def test_cube_roots_from_a_poor_start() -> None:
    target = np.linspace(-50, 50, 101)[:, None] + 1e-3
    root = solve(lambda x, _: (x**3, (3 * x**2)[:, None]), target, np.full((101, 1), 0.1))
    assert np.abs(root - np.cbrt(target)).max() < 1e-11


def test_steps_that_would_overshoot_are_shortened() -> None:
    """Newton without safeguard diverges on arctan from |x| > 1.4."""
    start = np.array([[5.0], [-80.0], [1.0]])
    root = solve(lambda x, _: (np.arctan(x), 1 / (1 + x**2)[:, None]), np.zeros((3, 1)), start)
    assert np.abs(root).max() < 1e-11


def test_two_unknowns_with_constants_of_their_own() -> None:
    turn = np.linspace(0.1, 3, 40)

    def spiral(x, rows):
        c, s = np.cos(turn[rows]), np.sin(turn[rows])
        jacobian = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
        return (jacobian @ x[:, :, None])[:, :, 0], jacobian

    root = solve(spiral, np.tile([1.0, 0.5], (40, 1)), np.zeros((40, 2)), steps=2)
    c, s = np.cos(turn), np.sin(turn)
    assert np.allclose(root, np.stack([c + 0.5 * s, 0.5 * c - s], axis=1))


def test_no_root_is_nan() -> None:
    root = solve(lambda x, _: (x**2 + 1, (2 * x)[:, None]), np.zeros((2, 1)), np.array([[0.3], [-2.0]]))
    assert np.isnan(root).all()
    unasked = solve(lambda x, _: (x, np.ones((len(x), 1, 1))), np.array([[np.nan]]), np.ones((1, 1)))
    assert np.isnan(unasked).all()


def test_smallest_positive_root() -> None:
    assert smallest_positive([3 + 0j, -1 + 0j, 2 + 0j, 0.5 + 0.1j], np.inf) == 2
    assert smallest_positive([], np.inf) == np.inf
