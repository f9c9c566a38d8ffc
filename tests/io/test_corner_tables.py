import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinholify.board import Checkerboard, size
from pinholify.corners import Corners, CornerSet, not_found
from pinholify.errors import CornerTableError, OutputError
from pinholify.io.corner_tables import read_corner_table, write_corner_table

BOARD = Checkerboard(3, 3)
IMAGE_SIZE = (640, 480)


def read(text, board=BOARD):
    return read_corner_table(io.StringIO(text), board=board, image_size=IMAGE_SIZE)


def written(*views):
    stream = io.StringIO()
    write_corner_table(stream, CornerSet(BOARD, IMAGE_SIZE, views))
    return stream.getvalue()


def lines(name, count=9, last="0"):
    return "".join(f"{name} {10 + i} {20 + i} {last}\n" for i in range(count))


names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12).filter(
    lambda name: name.split() == [name] and not name.startswith("#")
)
coordinates = st.floats(-1e6, 1e6, allow_nan=False)


@st.composite
def views(draw, name):
    ids = draw(st.lists(st.integers(0, size(BOARD) - 1), unique=True).map(sorted))
    if not ids:
        return not_found(name, "nothing there")
    uv = draw(st.lists(st.tuples(coordinates, coordinates), min_size=len(ids), max_size=len(ids)))
    weights = draw(st.just(1.0) | st.lists(st.floats(1e-6, 2), min_size=len(ids), max_size=len(ids)))
    return Corners(name, ids, uv, weights, "", draw(st.booleans()), draw(st.booleans()))


@st.composite
def corner_sets(draw):
    chosen = draw(st.lists(names, min_size=1, max_size=4, unique=True))
    return CornerSet(BOARD, IMAGE_SIZE, tuple(draw(views(name)) for name in chosen))


@given(corner_sets())
def test_what_is_written_is_read_back_exactly(corners):
    stream = io.StringIO()
    write_corner_table(stream, corners)
    back = read(stream.getvalue())
    assert (back.board, back.image_size) == (corners.board, corners.image_size)
    for found, view in zip(back.views, corners.views, strict=True):
        assert found.name == view.name
        np.testing.assert_array_equal(found.ids, view.ids)
        np.testing.assert_array_equal(found.uv, view.uv)
        np.testing.assert_array_equal(found.weights, view.weights)
        assert found.orientation_assumed == view.orientation_assumed
        assert found.ambiguous_offset == view.ambiguous_offset
        assert bool(found.reason) != found.found


def test_the_table_is_mrcals():
    uv = [[1.5, 2], [3, 4.25]]
    seen = Corners("a.png", [0, 8], uv, orientation_assumed=True, ambiguous_offset=True)
    rows = written(seen, not_found("b.png", "too dark")).splitlines()
    assert rows[:4] == ["# filename x y level", "## ambiguous-offset a.png", "## orientation-assumed a.png",
                        "a.png 1.5 2.0 0"]
    assert rows[4:11] == ["a.png - - -"] * 7
    assert rows[11:] == ["a.png 3.0 4.25 0", "b.png - - -"]


def test_level_is_not_a_weight():
    view, = read("# filename x y level\n" + lines("a.png", last="3")).views
    np.testing.assert_array_equal(view.weights, 1)


def test_weights_are_read_only_from_a_column_of_that_name_and_minus_or_zero_is_unseen():
    table = lines("a.png", 6, last="0.5") + "a.png 1 1 -\na.png 1 1 0\na.png 1 1 -1\n"
    view, = read("# filename x y weight\n" + table).views
    np.testing.assert_array_equal(view.ids, np.arange(6))
    np.testing.assert_array_equal(view.weights, 0.5)
    view, = read("# filename x y level\n" + table).views
    np.testing.assert_array_equal(view.ids, np.arange(9))


def test_a_corner_without_a_positive_weight_is_written_as_unseen():
    partly = Corners("a.png", [0, 1, 2], np.ones((3, 2)), [1, 0, 0.5])
    text = written(partly, Corners("b.png", [0], [[1, 1]], [0]))
    assert "a.png - - -" in text.splitlines()[2]
    back = read(text)
    np.testing.assert_array_equal(back.views[0].ids, [0, 2])
    assert not back.views[1].found


@pytest.mark.parametrize(
    "header", ["", "# filename x y\n", "# made by hand\n# filename x y level\n", "## any note at all\n"]
)
def test_headers_comments_and_blank_lines_do_not_matter(header):
    text = header + "\n" + lines("a.png").replace("\n", "\n# between\n\n")
    view, = read(text).views
    np.testing.assert_array_equal(view.uv[:, 0], np.arange(10, 19))


def test_an_image_without_a_board_may_be_short():
    assert [view.found for view in read("a.png - -\n" + lines("b.png")).views] == [False, True]
    assert not read("a.png - - -\n" * 9).views[0].found


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# comment\na.png 1 2 0\n" + lines("b.png"), r"line 2: 'a.png' has 1 lines .* 3x3 board needs 9"),
        ("# filename x y level\n" + lines("a.png", 10), r"line 2: 'a.png' has 10 lines .* needs 9"),
        (lines("a.png") + lines("b.png", 8), r"line 10: 'b.png' has 8 lines .* needs 9"),
        ("a.png - - -\n" * 2, r"'a.png' has 2 lines"),
        ("", "holds no corners"),
        ("# filename x y level\n", "holds no corners"),
        ("my photo.png 1 2 0\n", r"line 1: 5 words .* without blanks in the name"),
        ("a.png 1\n", "line 1: 2 words"),
        ("a.png 1 two 0\n", "line 1: 'two' was found"),
        ("a.png 1 nan 0\n", "line 1: 'nan' was found"),
        ("a.png 1 inf 0\n", "line 1: 'inf' was found"),
        ("a.png - 2 0\n", "line 1: '-' was found"),
        ("# filename x y weight\na.png 1 2 heavy\n", "line 2: 'heavy' was found"),
        ("# x y filename level\n", "line 1: the columns are 'x y filename level'"),
        ("a.png 1 " + "9" * 100_000 + "x 0\n", "line 1: '9{40}' was found"),
    ],
)
def test_a_broken_table_is_refused_with_the_place(text, words):
    with pytest.raises(CornerTableError, match=words):
        read(text)


def test_a_table_for_another_board_says_which_board_was_asked_for():
    with pytest.raises(CornerTableError, match="has 9 lines where a 4x4 board needs 16"):
        read(lines("a.png"), Checkerboard(4, 4))


@pytest.mark.parametrize("name", ["two words.png", "", "tab\there", "#1.png", "next\u2028line"])
def test_names_that_the_format_cannot_hold_are_refused_and_nothing_is_written(tmp_path, name):
    with pytest.raises(CornerTableError, match="rename the image"):
        write_corner_table(tmp_path / "c.vnl", CornerSet(BOARD, IMAGE_SIZE, (not_found(name, ""),)))
    assert list(tmp_path.iterdir()) == []


def test_files_that_are_missing_or_not_text_are_refused(tmp_path):
    (tmp_path / "photo.vnl").write_bytes(b"\xff\xd8\xff\xe0" + bytes(range(256)))
    for name, words in [("none.vnl", "there is no file"), ("photo.vnl", "not text")]:
        with pytest.raises(CornerTableError, match=words):
            read_corner_table(tmp_path / name, board=BOARD, image_size=IMAGE_SIZE)
    with pytest.raises(OutputError, match="does not exist"):
        write_corner_table(tmp_path / "none" / "c.vnl", read(lines("a.png")))


def test_a_table_of_the_bench_is_read_with_numpys_numbers(tmp_path):
    bench = Path(__file__).parents[2] / "../shared/bench/cases.py"
    if not bench.exists():
        pytest.skip("the bench beside the project is missing")
    command = [sys.executable, str(bench), "make", str(tmp_path), "barrel"]
    subprocess.run(command, check=True, capture_output=True)
    corners = read_corner_table(tmp_path / "barrel.vnl", board=Checkerboard(15, 9), image_size=(3840, 2160))
    whole = [view for view in corners.views if len(view) == 135]
    assert len(whole) > 20
    table = np.array([line.split() for line in (tmp_path / "barrel.vnl").read_text().splitlines()[1:]])
    for view in whole:
        np.testing.assert_array_equal(view.uv, table[table[:, 0] == view.name][:, 1:3].astype(float))
