"""The fit of two crossing edges, on windows with known corners."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import erf

from pinholify.detection.edges import fit_crossings
from pinholify.detection.prediction import local_frames, predict
from pinholify.detection.refine import fit_corners
from pinholify.detection.saddle import refine_saddles, sample
from pinholify.detection.windows import Windows

CENTRE = np.array([30.3, 28.7])


def corner(centre, angles, *, blur=1.0, shading=(0.0, 0.0), noise=0.0, seed=0, size=(64, 60)):
    """Grey levels of two edges through ``centre`` at ``angles`` (radians), analytic, and the edges' directions."""
    v, u = np.mgrid[0 : size[1], 0 : size[0]].astype(float)
    x, y = u - centre[0], v - centre[1]
    first, second = ([np.cos(a), np.sin(a)] for a in angles)
    across_first = erf((-first[1] * x + first[0] * y) / (blur * np.sqrt(2)))
    across_second = erf((second[1] * x - second[0] * y) / (blur * np.sqrt(2)))
    grey = (120 + 90 * across_first * across_second) * (1 + shading[0] * x / 60 + shading[1] * y / 60)
    grey = grey + np.random.default_rng(seed).normal(0, noise, grey.shape)
    return grey.astype(np.float32), np.array([first, second]).T


def window(uv, axes, half=12.0):
    return Windows(np.array([uv]), half * axes[None], np.zeros((1, 2, 3)))


@settings(max_examples=40, deadline=None)
@given(
    du=st.floats(-0.8, 0.8),
    dv=st.floats(-0.8, 0.8),
    turn=st.floats(0, 6.2),
    angle=st.floats(0.8, 2.3),
    blur=st.floats(0.8, 1.6),
)
def test_the_crossing_is_found_from_any_side(du, dv, turn, angle, blur):
    grey, axes = corner(CENTRE, (turn, turn + angle), blur=blur)
    found = fit_crossings(grey, window(CENTRE + np.array([du, dv]), axes))
    assert found.sound[0]
    assert np.abs(found.uv[0] - CENTRE).max() < 0.02
    assert found.strength[0] == pytest.approx(90, rel=0.1)


def test_shading_does_not_move_it_as_it_moves_a_quadratic_fit():
    grey, axes = corner(CENTRE, (0.1, 1.7), shading=(0.5, -0.3))
    found = fit_crossings(grey, window(CENTRE, axes))
    saddle = refine_saddles(grey, CENTRE[None], 12 * axes[None])
    assert np.linalg.norm(found.uv[0] - CENTRE) < 0.01
    assert np.linalg.norm(saddle.uv[0] - CENTRE) > 0.05


def errors_over_noises(half, draws=100):
    """Errors (n, 2) px of fits in windows of ``half`` px, and the standard deviation that they promised."""
    side = int(2.9 * half) + 12
    centre, errors, stds = np.array([side / 2 + 0.3, side / 2 - 0.2]), [], []
    for seed in range(draws):
        grey, axes = corner(centre, (0.3, 1.9), noise=8.0, seed=seed, size=(side, side))
        found = fit_crossings(grey, window(centre, axes, half))
        errors.append(found.uv[0] - centre)
        stds.append(found.std[0])
    return np.array(errors), float(np.sqrt(np.mean(np.square(stds))))


@pytest.mark.parametrize("half", [4.0, 8.0, 12.0, 25.0, 50.0])
def test_the_standard_deviation_is_the_spread_over_many_noises(half):
    """In windows that hold fewer pixels than are sampled, in some that hold more, and where only the edges are."""
    errors, std = errors_over_noises(half)
    spread = np.sqrt(np.mean(errors**2))
    assert 0.65 < spread / std < 1.25
    assert np.abs(errors.mean(axis=0)).max() < 4 * spread / np.sqrt(len(errors))


def test_longer_edges_place_a_corner_better():
    """As the root of their length: four times as long, half the error."""
    short, long = (np.sqrt(np.mean(errors_over_noises(half)[0] ** 2)) for half in (12.0, 48.0))
    assert long < 0.6 * short


def test_large_squares_are_fitted_along_their_edges():
    """As far as 50 px from the corner of a square of 150, and mostly where the edges are: 0.016 px within 20 px."""
    centre, errors = np.array([75.3, 74.8]), []
    for seed in range(60):
        grey, axes = corner(centre, (0.3, 1.9), noise=8.0, seed=seed, size=(150, 150))
        errors.append(fit_corners(grey, centre[None], 150.0 * axes[None], np.zeros((1, 2, 3))).uv[0] - centre)
    assert np.sqrt(np.mean(np.square(errors))) < 0.0117


def test_edges_sharper_than_pixels_are_no_outliers():
    """Where interpolation errs by more than noise, what errs still tells where the edges are: 0.006 px without it."""
    rng, parts, errors = np.random.default_rng(0), (-0.375, -0.125, 0.125, 0.375), []
    for _ in range(60):
        centre, turn = CENTRE + rng.uniform(-0.5, 0.5, 2), rng.uniform(0, 6.2)
        angles = (turn, turn + rng.uniform(1.2, 1.9))
        shifts = np.array([(du, dv) for du in parts for dv in parts])
        pixels = np.mean([corner(centre + shift, angles, blur=0.3)[0] for shift in shifts], axis=0)
        axes = corner(centre, angles)[1]
        errors.append(fit_crossings(np.round(pixels).astype(np.float32), window(centre, axes, 20.0)).uv[0] - centre)
    assert np.sqrt(np.mean(np.square(errors))) < 0.0045


def test_windows_of_all_sizes_are_fitted_as_each_alone():
    grey, axes = corner(CENTRE, (0.3, 1.9), noise=4.0)
    halves = np.array([5.0, 25.0, 9.0, 16.0])
    together = fit_crossings(grey, Windows(np.tile(CENTRE, (4, 1)), halves[:, None, None] * axes, np.zeros((4, 2, 3))))
    for i, half in enumerate(halves):
        alone = fit_crossings(grey, window(CENTRE, axes, half))
        assert np.abs(together.uv[i] - alone.uv[0]).max() < 0.01  # the one that takes most steps has all take them


def test_what_covers_a_part_of_the_window_is_forgotten():
    grey, axes = corner(CENTRE, (0.0, 1.5))
    grey[:22] = 60.0
    found = fit_crossings(grey, window(CENTRE, axes))
    assert np.linalg.norm(found.uv[0] - CENTRE) < 0.2


def test_a_window_may_reach_over_the_border():
    place = np.array([5.4, 28.7])
    grey, axes = corner(place, (0.2, 1.8))
    found = fit_crossings(grey, window(place + 0.4, axes))
    assert np.linalg.norm(found.uv[0] - place) < 0.02


def test_bilinear_sampling_is_exact_on_a_plane():
    v, u = np.mgrid[0:20, 0:30]
    uv = np.random.default_rng(0).uniform([0, 0], [29, 19], (50, 2))
    assert np.abs(sample((3 * u - 2 * v).astype(np.float32), uv) - (uv @ [3, -2])).max() < 1e-5


def test_prediction_follows_a_smooth_lattice():
    index = np.array([(i, j) for j in range(6) for i in range(8)])
    outside = np.array([(8, 2), (-1, 3), (4, 6)])
    def bend(k):
        return np.stack([50 * k[:, 0] + 0.8 * k[:, 0] ** 2, 45 * k[:, 1] - 0.5 * k[:, 0] * k[:, 1]], axis=1)
    expected = predict(index, bend(index), outside)
    miss = np.linalg.norm(expected.uv - bend(outside), axis=1)
    assert (miss < 2.0).all()
    assert (miss < 5 * expected.std).all()
    within = predict(index, bend(index), index, leave_out=True)
    assert within.std.max() > within.std.min() * 2
    jacobian, second = local_frames(index, bend(index))
    middle = (index == [4, 3]).all(axis=1)
    assert np.abs(jacobian[middle][0] - [[50 + 1.6 * 4, 0], [-1.5, 45 - 2]]).max() < 0.2
    assert np.abs(second[middle][0] - [[1.6, 0, 0], [0, -0.5, 0]]).max() < 0.2


@pytest.mark.parametrize(("bend", "half"), [(0.0, 49.5), (20.0, 23.7), (200.0, 20.0)])
def test_windows_end_where_lines_bend_too_much_to_be_known(bend, half):
    """Half windows, px, of squares of 150 px whose sides are off their tangents by ``bend`` ÷ 2 px."""
    centre = np.array([75.3, 74.8])
    grey, axes = corner(centre, (0.0, np.pi / 2), size=(150, 150))
    second = np.zeros((1, 2, 3))
    second[0, 1, 0] = bend
    found = fit_corners(grey, centre[None], 150.0 * axes[None], second)
    assert found.half[0] == pytest.approx(half, rel=0.01)
