"""How a board stands, what is worth keeping, and what to do next."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinholify.board import Charuco, Checkerboard, lattice
from pinholify.corners import Corners, not_found
from pinholify.geometry import Pose
from pinholify.simulation.views import board_poses, true_corners
from pinholify.web.guidance import FULL, advice, bars, choose, good_enough, outer_corners, posture
from small_camera import BOARD, LENS, SIZE


def view(pose: Pose, keep: slice = slice(None)) -> Corners:
    uv = true_corners(LENS, BOARD, pose)
    return Corners("a.png", np.arange(len(uv))[keep], uv[keep])


def flat(scale: float, left: float, top: float) -> Corners:
    """The board seen straight on by a camera without distortion."""
    uv = lattice(BOARD) * scale + [left, top]
    return Corners("a.png", np.arange(len(uv)), uv)


POSES = board_poses((LENS,), BOARD, 8, seed=3)


@pytest.mark.parametrize("pose", POSES)
def test_a_posture_of_a_part_is_nearly_that_of_the_whole(pose: Pose):
    whole = view(pose)
    assert np.allclose(outer_corners(whole, BOARD), whole.uv[[0, 8, 53, 45]])
    part = view(pose, slice(4, 50))
    assert posture(part, BOARD, SIZE).difference(posture(whole, BOARD, SIZE)) < 0.15


def test_each_measure_tells_what_it_is_called():
    middle, left = posture(flat(40, 160, 140), BOARD, SIZE), posture(flat(40, 20, 140), BOARD, SIZE)
    high, near = posture(flat(40, 160, 20), BOARD, SIZE), posture(flat(60, 80, 90), BOARD, SIZE)
    assert left.x < middle.x - 0.2
    assert left.y == pytest.approx(middle.y)
    assert high.y < middle.y - 0.2
    assert near.size == pytest.approx(1.5 * middle.size)
    for straight in (middle, left, high, near):
        assert astuple(straight)[3:] == pytest.approx((0, 0, 0), abs=1e-9)


def test_tilts_in_opposite_ways_are_different_postures():
    away, towards = (flat_tilted(sign) for sign in (-1, 1))
    first, second = posture(away, BOARD, SIZE), posture(towards, BOARD, SIZE)
    assert first.perspective_x * second.perspective_x < 0
    assert choose(towards, BOARD, SIZE, 1.0, [first], towards).keep


def flat_tilted(sign: int) -> Corners:
    angle = np.radians(40) * sign
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return view(Pose(rotation, np.array([0.0, 0.0, 12.0]) - rotation @ [4.0, 2.5, 0.0]))


@given(st.lists(st.sampled_from(POSES), max_size=6), st.sampled_from(POSES))
def test_bars_only_grow_and_end_at_one(poses: list[Pose], another: Pose):
    before = bars([posture(view(p), BOARD, SIZE) for p in poses])
    after = bars([posture(view(p), BOARD, SIZE) for p in [*poses, another]])
    assert set(before) == set(FULL)
    for name in FULL:
        assert 0 <= before[name] <= after[name] <= 1


def test_a_picture_is_kept_when_it_is_sharp_still_and_new():
    here, there = view(POSES[1]), view(POSES[2])
    assert choose(here, BOARD, SIZE, 1.0, [], here).keep
    assert choose(here, BOARD, SIZE, 1.0, [posture(there, BOARD, SIZE)], None).keep
    assert not choose(not_found("a", "nothing"), BOARD, SIZE, 1.0, [], None).keep
    blurred = choose(here, BOARD, SIZE, 9.0, [], here)
    assert not blurred.keep
    assert "sharp" in blurred.hint
    moving = choose(here, BOARD, SIZE, 1.0, [], Corners("a", here.ids, here.uv + 3.0))
    assert not moving.keep
    assert "still" in moving.hint
    known = choose(here, BOARD, SIZE, 1.0, [posture(here, BOARD, SIZE)], here)
    assert not known.keep
    assert "move or tilt" in known.hint


def test_advice_names_the_side_that_is_missing():
    at_left, at_top = flat(25, 5, 150), flat(25, 200, 5)
    seen = [posture(flat(60, 80, 90), BOARD, SIZE), posture(at_left, BOARD, SIZE), posture(at_top, BOARD, SIZE)]
    assert "fills the picture" in advice(bars([]), [])
    assert "Tilt" in advice(bars(seen), seen)
    only = {"x": 0.2, "y": 1.0, "size": 1.0, "skew": 1.0}
    assert "right" in advice(only, seen[1:2])
    assert "bottom" in advice({**only, "x": 1.0, "y": 0.2}, seen[2:])
    assert "few more" in advice(dict.fromkeys(FULL, 1.0), seen)


def test_a_charuco_boards_outline_comes_from_the_corners_that_are_seen():
    board = Charuco(8, 6, "DICT_4X4_100", 0.5)
    uv = lattice(board) * 30.0 + 50.0
    some = Corners("a.png", np.arange(3, 40), uv[3:40])
    assert np.allclose(outer_corners(some, board), uv[[0, 7, 47, 40]], atol=1e-6)


def test_contentment_wants_a_good_verdict_a_known_f_and_boards():
    good = {"f_px": 500.0, "f_px_std": 1.0, "level": "good", "photographs": ["a"] * 10}
    assert good_enough(good)
    unknown = {"f_px_std": None}
    for worse in ({"level": "fair"}, {"level": None}, {"f_px_std": 5.0}, unknown, {"photographs": ["a"] * 9}):
        assert not good_enough({**good, **worse})


def test_boards_of_other_shapes_have_postures_too():
    board = Checkerboard(3, 3)
    uv = lattice(board) * 50.0 + 100.0
    here = posture(Corners("a.png", np.arange(9), uv), board, (400, 300))
    assert here.size == pytest.approx(100 / np.sqrt(400 * 300))
