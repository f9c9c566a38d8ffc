"""Boards that look the same upside down are numbered alike by the shape they have of their own."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from pinholify import calibrate
from pinholify.board import Checkerboard
from pinholify.calibration.turning import turned_alike
from pinholify.corners import CornerSet
from pinholify.evaluation.summary import evaluate

from .conftest import cockled, make_scene

EVEN = Checkerboard(8, 6)


def corners(board: Checkerboard = EVEN, size: float = 0.004, seed: int = 0) -> CornerSet:
    warp = cockled(size, board=board) if size else None
    return make_scene("pinhole", views=16, noise=0.02, seed=seed, warp=warp, board=board).corners


def held(corner_set: CornerSet, upside_down: set[str]) -> CornerSet:
    last = corner_set.board.columns * corner_set.board.rows - 1
    return corner_set.with_views(
        replace(v, ids=last - v.ids) if v.name in upside_down else v for v in corner_set.views
    )


@pytest.fixture(scope="module")
def alike():
    return calibrate(corners(), reference="view00")


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_boards_held_upside_down_change_nothing(alike, share):
    rng = np.random.default_rng(1)
    upside_down = {v.name for v in corners().views[1:] if rng.random() < share}
    mixed = calibrate(held(corners(), upside_down), reference="view00")
    assert set(mixed.details["renumbered_boards"]) == upside_down
    np.testing.assert_allclose(astuple(mixed.camera.intrinsics), astuple(alike.camera.intrinsics), rtol=1e-6)
    assert mixed.camera.noise_px == pytest.approx(alike.camera.noise_px, rel=1e-4)
    scored = evaluate(mixed, held(corners(), upside_down), compare_opencv=False)
    assert scored.pooled.re_px == pytest.approx(evaluate(alike, corners(), compare_opencv=False).pooled.re_px, rel=1e-4)
    assert {b.file for b in scored.boards if b.note} == upside_down


def test_the_reference_keeps_its_numbering(alike):
    mixed = calibrate(held(corners(), {"view00", "view05"}), reference="view00")
    assert set(mixed.details["renumbered_boards"]) == {v.name for v in corners().views} - {"view00", "view05"}
    np.testing.assert_array_equal(mixed.corner_set.views[0].ids, held(corners(), {"view00"}).views[0].ids)
    assert mixed.camera.noise_px == pytest.approx(alike.camera.noise_px, rel=1e-4)


def test_new_photographs_are_numbered_as_the_shape_is(alike):
    new = held(corners(seed=7), {"view02", "view03"})
    found, notes = turned_alike(alike, new)
    assert set(notes) == {"view02", "view03"}
    for one, other in zip(found.views, corners(seed=7).views, strict=True):
        np.testing.assert_array_equal(one.ids, other.ids)


def test_corners_on_one_line_do_not_tell(alike):
    views = [view.select(view.ids < EVEN.columns) for view in held(corners(), {"view05"}).views]
    assert not turned_alike(alike, corners().with_views(views)).notes


@pytest.mark.parametrize(("board", "size"), [(Checkerboard(9, 6), 0.004), (EVEN, 0.0)], ids=["orientable", "flat"])
def test_nothing_is_turned_where_nothing_tells(board, size):
    calibration = calibrate(corners(board, size), reference="view00")
    assert not calibration.details["renumbered_boards"]
    assert not turned_alike(calibration, held(corners(board, size), {"view01"})).notes
