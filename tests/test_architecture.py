"""The layers hold, and the contracts that say so do break when they should."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import pinholify

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "pinholify"
MODULES = sorted(PACKAGE.rglob("*.py"))


def contracts(project):
    """Runs the contracts of ``project`` on its own source: whether they are kept, and what was printed."""
    code = "import sys; sys.path.insert(0, 'src'); from importlinter import cli; cli.lint_imports_command()"
    command = [sys.executable, "-c", code, "--no-cache", "--no-logo"]
    done = subprocess.run(command, cwd=project, capture_output=True, text=True)
    return done.returncode == 0, done.stdout + done.stderr


def test_the_layers_hold():
    kept, output = contracts(ROOT)
    assert kept, output


@pytest.mark.parametrize(
    ("files", "broken"),
    [
        ({"board.py": "import pinholify.corners"}, "A module imports only"),
        ({"errors.py": "import pinholify.arrays"}, "A module imports only"),
        ({"somewhere.py": ""}, "not listed as layers"),
        ({"corners.py": "import cv2"}, "The numeric core touches no images"),
        ({"geometry.py": "def plot():\n    import matplotlib.pyplot"}, "The numeric core touches no images"),
        ({"simulation.py": "import pinholify.gp", "gp.py": ""}, "Simulation and regression do not know"),
        ({"simulation.py": "", "camera.py": "import pinholify.simulation"}, "A module imports only"),
        ({"simulation.py": "import pinholify.charts", "charts.py": ""}, "Simulation and charts"),
        ({"simulation.py": "", "calibration.py": "import pinholify.simulation"}, "Simulation and calib"),
        ({"simulation.py": "", "refinement.py": "import pinholify.simulation"}, "Simulation and refinement"),
    ],
)
def test_a_breach_of_the_layers_is_seen(tmp_path, files, broken):
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    package = tmp_path / "src" / "pinholify"
    package.mkdir(parents=True)
    for name in ("__init__.py", "errors.py", "arrays.py", "geometry.py", "board.py", "corners.py"):
        (package / name).touch()
    kept, output = contracts(tmp_path)
    assert kept, output
    for name, text in files.items():
        (package / name).write_text(text)
    kept, output = contracts(tmp_path)
    assert not kept
    assert broken in output


def test_importing_the_package_loads_no_images_and_no_figures():
    code = "import sys, pinholify; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = done.stdout.split()
    assert "pinholify" in loaded
    assert not {"cv2", "matplotlib", "PIL", "reportlab"} & set(loaded)


def test_public_names_exist():
    for name in getattr(pinholify, "__all__", ()):
        assert hasattr(pinholify, name), name


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_nothing_is_ever_unpickled(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Import(names=names):
                assert not {"pickle", "marshal", "shelve", "dill", "joblib"} & {name.name for name in names}
            case ast.ImportFrom(module=module):
                assert module not in {"pickle", "marshal", "shelve", "dill", "joblib"}
            case ast.keyword(arg="allow_pickle", value=value):
                assert isinstance(value, ast.Constant)
                assert value.value is False
