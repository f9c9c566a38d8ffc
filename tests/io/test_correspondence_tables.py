"""Tables of correspondences: the same numbers back, and one sentence for everything wrong."""

import io

import numpy as np
import pytest

from pinholify.board import Checkerboard, Screen
from pinholify.corners import Corners, CornerSet, not_found
from pinholify.errors import CornerTableError
from pinholify.io.correspondence_tables import read_corners, read_correspondences, write_correspondences

SCREEN, SIZE = Screen(160, 96, 16), (640, 480)
HEADER = "filename,X,Y,u,v,std\n"


def table(text):
    return read_correspondences(io.StringIO(text), board=SCREEN, image_size=SIZE)


def test_what_is_written_is_read_again(tmp_path):
    rng = np.random.default_rng(0)
    ids = np.array([0, 3, 11, 59])
    views = [
        Corners(name, ids, rng.uniform(0, 400, (4, 2)), np.array([0.5, 1.0, 1.0, 2.0]))
        for name in ("pose 1", 'the "second", tilted')
    ]
    written = CornerSet(SCREEN, SIZE, (*views, not_found("dark", "dark")))
    write_correspondences(tmp_path / "c.csv", written, 0.02)
    assert (tmp_path / "c.csv").read_text().startswith(HEADER + "pose 1,7.5,7.5,")
    found = read_corners(tmp_path / "c.csv", board=SCREEN, image_size=SIZE)
    assert [view.name for view in found.views] == [view.name for view in views]
    for view, expected in zip(found.views, views, strict=True):
        np.testing.assert_array_equal(view.ids, expected.ids)
        np.testing.assert_array_equal(view.uv, expected.uv)
        np.testing.assert_allclose(view.weights, expected.weights)


def test_nodes_may_stand_in_any_order():
    view = table(HEADER + "a,23.5,7.5,2,3,0.1\n\na,7.5,7.5,1,2,0.1\n").views[0]
    np.testing.assert_array_equal(view.ids, [0, 1])
    np.testing.assert_array_equal(view.uv, [[1, 2], [2, 3]])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "line 1: the columns are not filename,X,Y,u,v,std"),
        ("a,b\n", "line 1: the columns are not"),
        (HEADER, "holds no correspondences"),
        (HEADER + "a,7.5,7.5,1\n", "line 2: a name, four finite numbers and a standard deviation"),
        (HEADER + "a,7.5,7.5,1,x,1\n", "line 2: a name"),
        (HEADER + "a,7.5,7.5,1,nan,1\n", "line 2: a name"),
        (HEADER + "a,7.5,7.5,1,2,0\n", "line 2: a name"),
        (HEADER + "a,8,7.5,1,2,1\n", r"line 2: \(8, 7.5\) is not a node of gray:160x96:16"),
        (HEADER + "a,7.5,7.5,1,2,1\na,1007.5,7.5,1,2,1\n", "line 3: .* is not a node"),
        (HEADER + "a,7.5,7.5,1,2,1\na,7.5,7.5,1,2,1\n", "line 3: 'a' has this node twice"),
    ],
)
def test_what_is_wrong_is_said(text, sentence):
    with pytest.raises(CornerTableError, match=sentence):
        table(text)


def test_another_board_is_refused(tmp_path):
    (tmp_path / "c.csv").write_text(HEADER + "a,7.5,7.5,1,2,1\n")
    with pytest.raises(CornerTableError, match="holds positions on a screen, but the board is 9x6"):
        read_corners(tmp_path / "c.csv", board=Checkerboard(9, 6), image_size=SIZE)
