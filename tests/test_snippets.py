"""The Python of the reference pages runs as it stands there, each block for itself, on rendered photographs."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from pinholify.detection import detect_files
from pinholify.io.camera_file import write_camera
from pinholify.io.export.base import export_view
from pinholify.io.images import write_image
from pinholify.pipeline import calibrate
from small_camera import BOARD, SMALL

DOCS = Path(__file__).parents[1] / "docs"
PHOTOGRAPHS = ("a.jpg", "b.jpg", "c.jpg", "d.jpg")


def blocks(page):
    """The fenced Python blocks of a page."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


PAGES = ("calibrate.md", "check.md", "import.md", "export.md")
SNIPPETS = [
    pytest.param(code, id=f"{page}-{number}")
    for page in PAGES
    for number, code in enumerate(blocks(page))
    if "import mrcal" not in code  # mrcal's own functions, which its package serves to the system's Python
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the pages take for granted: photographs, a camera file, and its exports."""
    folder = tmp_path_factory.mktemp("snippets")
    names = (*PHOTOGRAPHS, "new-1.jpg", "new-2.jpg", "photo.jpg")
    for name, picture in zip(names, SMALL.photographs(), strict=True):
        write_image(folder / name, picture.image)
    calibration = calibrate(detect_files([folder / name for name in names], BOARD))
    write_camera(folder / "camera.npz", calibration)
    export_view(calibration.camera, "opencv", folder / "camera.yaml")
    export_view(calibration.camera, "mrcal-splined", folder / "camera.cameramodel")
    return folder


@pytest.mark.parametrize("code", SNIPPETS)
def test_a_snippet_runs_as_it_stands(code, folder, tmp_path, monkeypatch):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)  # what it writes is its own
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "snippet", "exec"), names := {"__name__": "snippet"})
    if "straight" in names:
        assert np.asarray(names["straight"]).max() > 0
