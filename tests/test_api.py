"""The library's public face: every name is there, and the example of the package's docstring works."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pinholify
from pinholify import points
from pinholify.board import Checkerboard
from pinholify.corners import not_found
from pinholify.io.images import write_image
from pinholify.simulation.datasets import Dataset
from pinholify.simulation.lenses import BrownConrady
from pinholify.simulation.photograph import Sensor
from tilted import tilted_calibration

LENS = BrownConrady((640, 480), (420.0, 420.0), (6.0, -4.0), (-0.18, 0.03, 0.0))
SMALL = Dataset("small", "A small camera", LENS, Checkerboard(15, 9), 3, Sensor(read_noise=1.0), 11, {})


@pytest.mark.parametrize("name", pinholify.__all__)
def test_every_public_name_is_there_and_documented(name):
    value = getattr(pinholify, name)
    assert value.__name__ == name
    assert inspect.getdoc(value)
    assert name in dir(pinholify)


def test_the_names_are_listed_once_everywhere():
    """``__all__``, the table of homes and the imports that type checkers read agree."""
    assert pinholify.__all__ == sorted(set(pinholify.__all__))
    assert set(pinholify.__all__) == set(pinholify._HOMES)
    tree = ast.parse(Path(pinholify.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: node.module.removeprefix("pinholify.") for node in imports for alias in node.names}
    assert homes == pinholify._HOMES


def test_unknown_name():
    with pytest.raises(AttributeError, match="'pinholify' has no attribute 'nothing'"):
        _ = pinholify.nothing


def test_importing_costs_nothing():
    code = "import sys, pinholify; print([m for m in ('numpy', 'cv2', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def example() -> str:
    """The code in the package's docstring."""
    lines = pinholify.__doc__.split("::\n", 1)[1].splitlines()
    return inspect.cleandoc("\n".join(line for line in lines if line.startswith("    ") or not line))


def test_example_of_the_docstring(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    for name, picture in zip("abc", SMALL.photographs(), strict=True):
        write_image(f"{name}.jpg", picture.image)
    names: dict[str, object] = {}
    exec(example(), names)
    calibration = names["calibration"]
    assert isinstance(calibration, pinholify.Calibration)
    k = calibration.camera.intrinsics
    assert np.abs(np.array([k.f, k.uc, k.vc]) - SMALL.truth().virtual_camera).max() < 0.05
    straight = names["straight"]
    assert isinstance(straight, np.ndarray)
    assert straight.shape[:2] == (480, 640)
    assert straight.std() > 20


def test_what_is_printed_of_results_is_for_people():
    """In a REPL no one wants thousands of lines of arrays."""
    calibration = tilted_calibration()
    assert repr(calibration).startswith("<one-image calibration from '")
    assert " ± " in repr(calibration)
    assert " squares, noise 0.0" in repr(calibration)
    assert repr(calibration.corner_set) in repr(calibration)
    assert repr(calibration.corner_set.found[0]).endswith(": 54 corners>")
    assert repr(not_found("a.jpg", "no board found")) == "<a.jpg: no board found>"
    assert len(repr(calibration)) < 200


def test_points_shows_its_functions_alone():
    assert dir(points) == sorted(points.__all__)
    assert all(getattr(points, name).__module__ == "pinholify.points" for name in dir(points))
