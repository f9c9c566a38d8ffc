import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pinholify.errors import InputError, OutputError
from pinholify.io.point_tables import read_points, write_points

numbers = st.floats(-1e5, 1e5) | st.just(np.nan)


def read(text, **options):
    return read_points(io.StringIO(text), **options)


shapes = st.tuples(st.integers(0, 30), st.sampled_from([2, 3]))


@given(arrays(np.float64, shapes, elements=numbers))
def test_what_is_written_is_read_back(points):
    stream = io.StringIO()
    write_points(stream, ["x", "y", "z"][: points.shape[1]], points)
    stream.seek(0)
    back = read_points(stream)
    assert back.shape == points.shape
    np.testing.assert_allclose(back, points, rtol=0, atol=1e-9)


def test_chunks_join_without_a_seam(tmp_path):
    points = np.random.default_rng(1).uniform(-5000, 5000, (25_001, 2))
    write_points(tmp_path / "p.csv", ["u", "v"], points)
    np.testing.assert_allclose(read_points(tmp_path / "p.csv"), points, rtol=0, atol=1e-9)


def test_the_text_is_plain():
    stream = io.StringIO()
    write_points(stream, ["x", "y", "std_x", "std_y"], [[0.1, -2, np.nan, 1e-7], [1 / 3, 0, 0, 0]])
    assert stream.getvalue() == "x,y,std_x,std_y\n0.1,-2,nan,1e-07\n0.333333333333333,0,0,0\n"


@pytest.mark.parametrize(
    ("text", "points"),
    [
        ("u,v\n1,2\n3,4\n", [[1, 2], [3, 4]]),
        ("u,v\n1,2\n3,4\n\n \n", [[1, 2], [3, 4]]),
        ("u,v\n 1 , 2e1\n", [[1, 20]]),
        ("x,y,std_px\n1,2,3\n", [[1, 2]]),
        ("x,y,z,std_px\n1,2,3,0.1\n", [[1, 2, 3]]),
        ('"x", "y", "z"\n1,2,3\n', [[1, 2, 3]]),
        ("x,y,name\n1,2,left\n3,4,right\n", [[1, 2], [3, 4]]),
        ("u,v\n1,2\n3,4,5\n", [[1, 2], [3, 4]]),
        ("id,x,y,z\na,1,2,3\n", [[1, 2, 3]]),
        ("u,v,x,y\n9,9,1,2\n", [[1, 2]]),
        ("a,b,u\n1,2,3\n", [[1, 2]]),
        ("u,v\nnan,nan\nNaN,2\n", [[np.nan, np.nan], [np.nan, 2]]),
        ("u,v\n", np.empty((0, 2))),
    ],
)
def test_columns_are_chosen_and_the_rest_is_left_alone(text, points):
    np.testing.assert_array_equal(read(text), points)


def test_files_from_spreadsheets_are_read(tmp_path):
    (tmp_path / "p.csv").write_bytes(b"\xef\xbb\xbfu,v\r\n1,2\r\n3,4\r\n")
    np.testing.assert_array_equal(read_points(tmp_path / "p.csv"), [[1, 2], [3, 4]])
    np.testing.assert_array_equal(read("u,v\r\n1,2\r\n\r\n"), [[1, 2]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty; a header line such as u,v"),
        ("\n\n", "is empty"),
        ("1,2\n3,4\n", "line 1: numbers where a header such as u,v is needed"),
        ("u;v\n1;2\n", "line 1: the header has 1 of the 2 columns that are needed, separated by commas"),
        ("u,v\n1,2\n\n3,4\n", "line 3: 0 numbers were found where 2 are needed"),
        ("u,v\n1,2\n3\n", "line 3: 1 numbers were found where 2 are needed"),
        ("u,v\n1,2\n3,\n", "line 3: '' was found where a finite number"),
        ("u,v\n1,2\n3,four\n", "line 3: 'four' was found"),
        ("u,v\n1,2\n3,4\ninf,2\n", "line 4: 'inf' was found"),
        ("u,v\n1,1e999\n", "line 2: '1e999' was found"),
        ("u,v\n1,1_0\n", "line 2: '1_0' was found"),
        ("u,v\n#1,2\n", "line 2: '#1' was found"),
        ("u,v\n1," + "x" * 100_000, "line 2: 'x{40}' was found"),
        ("x,y,z\n1,2\n", "line 2: 2 numbers were found where 3 are needed"),
    ],
)
def test_a_broken_table_is_refused_with_the_line(text, words):
    with pytest.raises(InputError, match=words) as caught:
        read(text)
    assert "standard input" in str(caught.value)


def test_rays_are_asked_for_by_name_or_by_number():
    np.testing.assert_array_equal(read("a,b,c\n1,2,3\n", dimensions=3), [[1, 2, 3]])
    with pytest.raises(InputError, match="such as x,y,z"):
        read("", dimensions=3)
    with pytest.raises(InputError, match="the header has 2 of the 3 columns"):
        read("u,v\n1,2\n", dimensions=3)


def test_files_that_cannot_be_read_or_written_are_named(tmp_path):
    with pytest.raises(InputError, match="there is no file"):
        read_points(tmp_path / "none.csv")
    with pytest.raises(OutputError, match="folder does not exist"):
        write_points(tmp_path / "none" / "p.csv", ["u", "v"], np.zeros((1, 2)))


def test_a_header_that_does_not_fit_writes_nothing(tmp_path):
    with pytest.raises(ValueError, match="shape"):
        write_points(tmp_path / "p.csv", ["u", "v"], np.zeros((4, 3)))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "text",
    ["id,u,v\n7,1,2\n8,3,4\n", "v,name,u\n2,a,1\n4,b,3\n", "x,y,u,v\n9,9,1,2\n9,9,3,4\n", "n,y,x\n9,2,1\n9,4,3\n"],
)
def test_pixels_are_found_by_name(text):
    np.testing.assert_array_equal(read(text, dimensions=2), [[1, 2], [3, 4]])


def test_columns_that_are_left_out_are_told():
    told = []
    read("id,u,v,name\n7,1,2,a\n", dimensions=2, on_unused=told.append)
    read("u,v\n1,2\n", dimensions=2, on_unused=told.append)
    assert told == [["id", "name"]]


def test_a_wrong_number_is_blamed_in_its_own_column():
    with pytest.raises(InputError, match="line 3: 'x' was found where a finite number or nan is needed"):
        read("id,u,v\nx,1,2\n8,x,4\n", dimensions=2)
    with pytest.raises(InputError, match="line 2: 2 numbers were found where 3 are needed"):
        read("id,u,v\n1,2\n", dimensions=2)
