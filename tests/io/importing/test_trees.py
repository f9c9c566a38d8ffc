"""The small YAML and XML readers: PyYAML and OpenCV as witnesses, and hostile text."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinholify.io.importing.trees import xml_tree, yaml_tree

CHAIN = {
    "cam0": {
        "cam_overlaps": [1],
        "camera_model": "pinhole",
        "distortion_coeffs": [-0.28, 0.074, 0.00019, 1.76e-05],
        "intrinsics": [458.654, 457.296, 367.215, 248.375],
        "resolution": [752, 480],
        "rostopic": "/cam0/image_raw",
        "T_cam_imu": [[1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, -0.25], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
    },
    "cam1": {"camera_model": "ds", "nested": {"deeper": {"a": [1], "b": "text"}}},
}
WORDS = ("null", "true", "false", "yes", "no", "on", "off", "y", "n")  # that YAML 1.1 takes for something else
NAMES = st.from_regex(r"\A[a-z][a-z_0-9/]{0,8}\Z").filter(lambda name: name not in WORDS)
VALUES = NAMES | st.integers(-1000, 1000) | st.floats(-1e6, 1e6) | st.lists(st.integers(), min_size=1, max_size=5)
TREES = st.dictionaries(NAMES, VALUES | st.dictionaries(NAMES, VALUES, min_size=1, max_size=3), min_size=1, max_size=4)


@pytest.mark.parametrize("flow", [None, False, True])
def test_a_camchain_as_pyyaml_writes_it(flow):
    yaml = pytest.importorskip("yaml")
    assert yaml_tree(yaml.safe_dump(CHAIN, default_flow_style=flow)) == CHAIN


@settings(max_examples=50)
@given(tree=TREES, indent=st.sampled_from([2, 4]), flow=st.sampled_from([None, False, True]))
def test_whatever_pyyaml_writes_of_such_trees(tree, indent, flow):
    yaml = pytest.importorskip("yaml")
    assert yaml_tree(yaml.safe_dump(tree, default_flow_style=flow, indent=indent)) == tree


@pytest.mark.parametrize(
    "text",
    [
        "a: {rows: 1, cols: 2, data: [1, 2.5]}",
        "a: {b: {c: [x, y z]}, d: []}\ne: [{f: 1}, {g: 'h, i'}]",
        'a: {"b": 1, "c":"d]", url: http://e:1/f}\ng: {}',
        "a: {\n  b: 1,\n  c: 2,\n  }\nd: text {with [brackets",
        "- {a: 1}\n- [b, c]",
    ],
)
def test_collections_in_brackets_are_read_as_pyyaml_reads_them(text):
    yaml = pytest.importorskip("yaml")
    assert yaml_tree(text) == yaml.safe_load(text)


def test_comments_directives_and_lists_over_lines():
    text = "%YAML:1.0\n---\n# about\na: [1,  # one\n   2.,\n  .5]\n'b' : \"x # y\"\nc:\n- 1\n-  2\n"
    assert yaml_tree(text.replace("x # y", "x y")) == {"a": [1, 2.0, 0.5], "b": "x y", "c": [1, 2]}


@pytest.mark.parametrize("suffix", [".yml", ".xml"])
def test_what_opencv_writes(suffix):
    matrix = np.random.default_rng(0).normal(size=(3, 3))
    storage = cv2.FileStorage(suffix, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("camera_matrix", matrix)
    storage.write("image_width", 640)
    storage.write("date", "Sun, 22 Nov")
    text = storage.releaseAndGetString()
    tree = yaml_tree(text) if suffix == ".yml" else xml_tree(text)
    np.testing.assert_array_equal(np.reshape(tree["camera_matrix"]["data"], (3, 3)), matrix)
    assert (tree["image_width"], tree["camera_matrix"]["rows"]) == (640, 3)


HOSTILE = {
    "nothing": "",
    "words": "a b c",
    "open bracket": "a: [1, 2",
    "open brace": "a: {b: 1",
    "wrong bracket": "a: {b: [1}]",
    "no value": "a: {b}",
    "no comma": "a: [[x] [y]]",
    "nested braces": "a: " + "{b: " * 50_000 + "1" + "}" * 50_000,
    "brackets": "[" * 100_000,
    "closed brackets": "a: " + "[" * 50_000 + "]" * 50_000,
    "stairs": "".join(" " * i + "a:\n" for i in range(500)),
    "dashes": "- " * 1000,
    "minus signs": "a: " + "-" * 100_000 + "1",
    "alias": "a: &x [*x]\nb: *x\n  c",
    "odd indentation": "a:\n    b: 1\n  c: 2\n",
    "tag": "a: !!python/object/apply:os.system ['false']\n b",
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_hostile_yaml_is_refused_or_harmless(text):
    """No more than plain values come of it, or an error of the kinds that the reader of files catches."""
    try:
        tree = yaml_tree(text)
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        return
    assert isinstance(tree, dict)
    assert all(isinstance(value, str) for value in tree.values())


def test_many_lines_take_no_longer_each():
    """A hundred thousand numbers on as many lines: quadratic reading would not end."""
    assert len(yaml_tree("a: [" + ",\n".join("1" * 100_000) + "]")["a"]) == 100_000
    assert len(yaml_tree("a:\n" + "- 1\n" * 50_000)["a"]) == 50_000


@pytest.mark.parametrize(
    "text",
    [
        "<a>",
        "<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>",
        "<a>" * 100 + "</a>" * 100,
        "<?xml version='1.0'?>",
        "<a><b></a></b>",
    ],
)
def test_hostile_xml_is_refused(text):
    with pytest.raises(ValueError):
        xml_tree(text)
