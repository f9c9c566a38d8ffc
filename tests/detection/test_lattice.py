import numpy as np
import pytest

from pinholify.board import Checkerboard, lattice
from pinholify.detection.lattice import Lattice, orient, turns


def seen(board: Checkerboard, *, turn: float, phase: int) -> Lattice:
    """The board turned by ``turn`` degrees in the image; phase as of index (0, 0)."""
    index = lattice(board)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    uv = index @ np.array([[c, s], [-s, c]]) * 30 + 500
    return Lattice(index.astype(np.int64), uv, np.ones(len(uv)), phase)


def test_four_quarter_turns_are_the_identity():
    first = seen(Checkerboard(4, 3), turn=10, phase=1)
    last = turns(first, mirrored=False)[3].turned()
    assert np.array_equal(first.index, last.index)
    assert first.phase == last.phase


@pytest.mark.parametrize("mirrored", [False, True])
def test_every_way_to_count_has_the_same_handedness(mirrored):
    for way in turns(seen(Checkerboard(5, 4), turn=33, phase=1), mirrored=mirrored):
        affine = np.linalg.lstsq(np.column_stack([way.index, np.ones(len(way))]), way.uv, rcond=None)[0]
        assert np.sign(np.linalg.det(affine[:2])) == (-1 if mirrored else 1)


def test_turning_keeps_the_colour_of_every_square():
    """The square up and left of a corner, found by its place in the image, keeps its colour."""
    first = seen(Checkerboard(5, 4), turn=0, phase=1)
    for way in turns(first, mirrored=False):
        for corner in range(len(way)):
            k = way.index[corner] - [1, 1]
            opposite = (way.index == k).all(axis=1)
            if not opposite.any():
                continue
            bright = way.phase * (-1) ** abs(way.index[corner].sum())
            middle = (way.uv[corner] + way.uv[opposite][0]) / 2
            column, row = np.floor((middle - 500) / 30).astype(int)
            assert bright == first.phase * (-1) ** (column + 1 + row + 1)


@pytest.mark.parametrize("phase", [1, -1])
@pytest.mark.parametrize("turn", [0, 80, 180, 300])
def test_colour_orients_an_odd_board(phase, turn):
    board = Checkerboard(5, 4)
    first = seen(board, turn=turn, phase=phase)
    ways = [w.at_origin() for w in turns(first, mirrored=False) if w.extent == (5, 4)]
    chosen, assumed = orient(ways, board)
    assert not assumed
    assert chosen.phase == -1
    start = np.flatnonzero(chosen.ids(board) == 0)[0]
    assert start == (0 if phase < 0 else 19)


@pytest.mark.parametrize(("columns", "rows"), [(6, 4), (5, 5), (4, 4)])
@pytest.mark.parametrize("turn", [0, 50, 130, 200, 290])
def test_what_colour_cannot_tell_starts_nearest_the_top_left(columns, rows, turn):
    board = Checkerboard(columns, rows)
    first = seen(board, turn=turn, phase=1)
    ways = [w.at_origin() for w in turns(first, mirrored=False) if w.extent == (columns, rows)]
    chosen, assumed = orient(ways, board)
    assert assumed
    ids = chosen.ids(board)
    assert sorted(ids) == list(range(columns * rows))
    distance = np.linalg.norm(chosen.uv, axis=1)
    assert distance[ids == 0] <= distance[ids == columns * rows - 1]
