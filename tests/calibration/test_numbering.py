"""Boards numbered the other way round are found, renumbered and named; a board of another size is named."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinholify.board import lattice, parse_board, size
from pinholify.calibration.numbering import check_numbering, check_size, numbered_alike, numbered_backwards
from pinholify.calibration.one_image import calibrate_one_image
from pinholify.corners import Corners, CornerSet, not_found
from pinholify.errors import CalibrationError, InputError
from pinholify.pipeline import calibrate
from pinholify.simulation.lenses import LENSES
from pinholify.simulation.views import board_poses, true_corners
from synthetic import BOARD, corner_set

SIZE = (2000, 2000)
SYMMETRIC = ("15x9", "8x8", "charuco:9x7:DICT_4X4_100:0.5", "aprilgrid:6x5:tag36h11:0.3", "circles:4x11:asymmetric")


def backwards(view, board, axis):
    """``view`` as somebody counts it who starts at the other end of ``axis``; None where the board has no such end."""
    points = lattice(board)
    wanted = points.copy()
    wanted[:, axis] = points[:, axis].max() + points[:, axis].min() - points[:, axis]
    known = {tuple(np.round(p, 6)): i for i, p in enumerate(points)}
    ids = [known.get(tuple(np.round(p, 6))) for p in wanted]
    return None if None in ids else dataclasses.replace(view, ids=np.array(ids)[view.ids])


def seen(board, homography, keep, mirrored):
    """Some corners of ``board`` as a plane camera, or a mirror, shows them."""
    ids = np.flatnonzero(keep)
    points = np.column_stack([lattice(board)[ids], np.ones(len(ids))]) @ homography.T
    uv = points[:, :2] / points[:, 2:]
    return Corners("board", ids, uv * [-1, 1] if mirrored else uv)


@settings(max_examples=60, deadline=None)
@given(
    spec=st.sampled_from(SYMMETRIC),
    axis=st.sampled_from([0, 1]),
    turn=st.floats(-0.7, 0.7),
    slants=st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)),
    share=st.floats(0.3, 1.0),
    mirrored=st.booleans(),
    seed=st.integers(0, 99),
)
def test_a_board_numbered_backwards_is_numbered_as_it_was(spec, axis, turn, slants, share, mirrored, seed):
    board = parse_board(spec)
    rotation = 50 * np.array([[np.cos(turn), -np.sin(turn), 9], [np.sin(turn), np.cos(turn), 7], [0, 0, 0.02]])
    rotation[2, :2] = slants
    view = seen(board, rotation, np.random.default_rng(seed).random(size(board)) < share, mirrored)
    assert not numbered_backwards(view, board, mirrored)
    wrong = backwards(view, board, axis)
    if wrong is None:  # an asymmetric circle grid has one such axis alone
        wrong = backwards(view, board, 1 - axis)
    assert numbered_backwards(wrong, board, mirrored)
    found, notes = numbered_alike(CornerSet(board, SIZE, (wrong,)), mirrored)
    np.testing.assert_array_equal(found.views[0].ids, view.ids)
    np.testing.assert_array_equal(found.views[0].uv, view.uv)
    assert "the other way round" in notes["board"]


def test_the_note_names_what_was_reversed():
    views = list(corner_set().views)
    views[2], views[4] = backwards(views[2], BOARD, 0), backwards(views[4], BOARD, 1)
    _, notes = numbered_alike(CornerSet(BOARD, SIZE, tuple(views)), False)
    assert notes == {
        views[2].name: "numbered the other way round (columns reversed)",
        views[4].name: "numbered the other way round (rows reversed)",
    }


def test_boards_that_cannot_be_told_or_reversed_stay():
    view = corner_set().views[0]
    columns = BOARD.columns
    few, line = view.select(view.ids % columns + view.ids // columns < 2), view.select(view.ids < columns)
    found, notes = numbered_alike(CornerSet(BOARD, SIZE, (view, not_found("none", "dark"))), False)
    assert not notes
    assert [len(v) for v in found.views] == [len(view), 0]
    assert not any(numbered_backwards(v, BOARD, mirrored) for v in (few, line) for mirrored in (False, True))
    stacked = parse_board("circles:4x10:asymmetric")  # an even number of rows: no axis of symmetry
    points = lattice(stacked) * [-1, 1] * 30 + 900
    odd = CornerSet(stacked, SIZE, (Corners("odd", np.arange(len(points)), points),))
    same, notes = numbered_alike(odd, False)
    assert not notes
    np.testing.assert_array_equal(same.views[0].ids, odd.views[0].ids)


@pytest.mark.parametrize("mirrored", [False, True])
def test_where_most_are_reversed_it_is_not_the_boards(mirrored):
    views = corner_set().views
    if mirrored:
        views = tuple(Corners(v.name, v.ids, v.uv * [-1, 1] + [2000, 0]) for v in views)
    right = CornerSet(BOARD, SIZE, views)
    check_numbering(right, mirrored)
    with pytest.raises(InputError, match=r"9 of 9 boards are numbered .* 'mirrored'"):
        check_numbering(right, not mirrored)
    few = [backwards(v, BOARD, 0) if i < 4 else v for i, v in enumerate(views)]
    check_numbering(right.with_views(few), mirrored)
    with pytest.raises(InputError, match="5 of 9"):
        check_numbering(right.with_views(few), not mirrored)


@pytest.mark.parametrize("method", ["one-image", "joint"])
def test_a_reversed_board_counts_as_if_it_were_not(method):
    right = corner_set()
    views = list(right.views)
    for index, axis in ((0, 1), (3, 0)):  # the reference is one of them
        views[index] = backwards(views[index], BOARD, axis)
    options = {"method": method, "reference": views[0].name, "trend": "lens:2" if method == "one-image" else "plane:2"}
    clean, spoilt = calibrate(right, **options), calibrate(right.with_views(views), **options)
    assert dataclasses.astuple(clean.camera.intrinsics) == dataclasses.astuple(spoilt.camera.intrinsics)
    np.testing.assert_array_equal(spoilt.corner_set.views[3].ids, right.views[3].ids)
    assert set(spoilt.details["renumbered_boards"]) == {views[0].name, views[3].name}
    assert not clean.details["renumbered_boards"]
    assert not spoilt.details.get("dropped_boards")


def test_the_numbers_of_one_image_alone_are_taken_as_they_are():
    """Below the pipeline nothing is renumbered."""
    views = list(corner_set().views)
    views[0] = backwards(views[0], BOARD, 0)
    with pytest.raises(InputError, match="left-handed"):
        calibrate_one_image(CornerSet(BOARD, SIZE, tuple(views)), reference=views[0].name, trend="lens:2")


@pytest.mark.parametrize("given", ["9x15", "14x10", "16x9"])
@pytest.mark.parametrize("method", ["joint", "one-image"])
def test_a_board_given_with_the_wrong_number_of_columns_is_named(given, method):
    true = corner_set(6, squeeze=0.15)
    wrong = CornerSet(parse_board(given), true.image_size, true.views)
    with pytest.raises(CalibrationError, match=f"numbered as on a 15x9 board, not {given}: give the board as 15x9"):
        calibrate(wrong, method=method)


def test_corners_numbered_column_by_column_are_named():
    true = corner_set(6)
    column, row = np.divmod(np.arange(135), 9)
    order = row * 15 + column
    views = [dataclasses.replace(view, uv=view.uv[order]) for view in true.views]
    with pytest.raises(CalibrationError, match="numbered as on a 9x15 board, not 15x9"):
        calibrate(true.with_views(views))


@pytest.mark.parametrize("lens", ["fisheye", "unity-barrel", "windscreen"])
@pytest.mark.parametrize("spec", ["30x20", "4x4", "circles:4x11:asymmetric"])
def test_no_lens_makes_a_board_look_like_one_of_another_size(lens, spec):
    board, camera = parse_board(spec), LENSES[lens]
    rng = np.random.default_rng(0)
    views = []
    for i, pose in enumerate(board_poses([camera], board, 4, seed=2)):
        uv = true_corners(camera, board, pose)
        wrong = rng.random(len(uv)) < 0.1
        views.append(Corners(f"view{i}", np.arange(len(uv)), uv + wrong[:, None] * rng.normal(0.0, 50.0, uv.shape)))
    check_size(CornerSet(board, camera.size, tuple(views)))


def test_boards_of_few_corners_or_on_one_line_have_no_size():
    line = Corners("line", np.arange(15), np.column_stack([np.arange(15.0), np.zeros(15)]))
    same = Corners("same", np.arange(135), np.full((135, 2), 7.0))
    check_size(CornerSet(BOARD, SIZE, (line, not_found("none", "dark"))))
    check_size(CornerSet(BOARD, SIZE, (same,)))
    check_size(CornerSet(BOARD, SIZE, ()))
