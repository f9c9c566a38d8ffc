"""A small camera with hostile file names, its photographs, and its report."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pinholify.corners import CornerSet, not_found
from pinholify.evaluation.summary import evaluate
from pinholify.evaluation.verdict import judge
from pinholify.io.camera_file import write_camera
from pinholify.io.images import write_image
from pinholify.pipeline import calibrate
from pinholify.report.contents import make_report
from pinholify.report.photographs import nearby
from pinholify.report.pictures import read_pictures
from pinholify.report.provenance import provenance_of
from pinholify.simulation.views import board_poses
from small_camera import BOARD, LENS, SIZE, corner_set

NOISE = 0.05
HOSTILE = "a<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'<|*_`&amp;.png"


@pytest.fixture
def hostile() -> str:
    """A name that would run a script, were it not escaped."""
    return HOSTILE


@pytest.fixture
def noise() -> float:
    """The noise of the corners, px per axis."""
    return NOISE


@pytest.fixture(scope="session")
def poses():
    """Nine poses; the first is the reference's."""
    return board_poses((LENS,), BOARD, 9, seed=3)


@pytest.fixture(scope="session")
def corners(poses) -> CornerSet:
    """Nine boards, one called by a hostile name, and an image that shows none."""
    views = list(corner_set(poses, noise=NOISE).views)
    views[1] = dataclasses.replace(views[1], name=HOSTILE)
    return CornerSet(BOARD, SIZE, (*views, not_found("street.png", "no board found")))


@pytest.fixture(scope="session")
def evaluation(corners):
    """The one-image camera of these corners, evaluated."""
    calibration = calibrate(corners, method="one-image", trend="lens:1", reference="a0.png", square_mm=25.0)
    return evaluate(calibration, corners)


@pytest.fixture(scope="session")
def folder(tmp_path_factory, corners, evaluation) -> Path:
    """The camera file ``it's <b>.npz`` with a picture for every view beside it."""
    place = tmp_path_factory.mktemp("camera")
    write_camera(place / "it's <b>.npz", evaluation.calibration)
    rng = np.random.default_rng(0)
    for view in corners.views:
        coarse = rng.integers(0, 255, (12, 16, 3), dtype=np.uint8)
        picture = place / "picture.png"
        write_image(picture, np.kron(coarse, np.ones((40, 40, 1), dtype=np.uint8)))
        picture.rename(place / view.name)
    return place


@pytest.fixture(scope="session")
def camera_file(folder) -> Path:
    """The camera file."""
    return folder / "it's <b>.npz"


@pytest.fixture(scope="session")
def verdict(evaluation, corners):
    """The verdict on the camera."""
    return judge(evaluation, corners)


@pytest.fixture(scope="session")
def report(evaluation, verdict, corners, camera_file):
    """The whole report, with photographs."""
    photographs = nearby([view.name for view in corners.views], [camera_file.parent])
    pictures = read_pictures(evaluation.calibration, photographs.by_name)
    return make_report(evaluation, verdict, provenance_of(camera_file), pictures)


@pytest.fixture(scope="session")
def bare_report(evaluation, verdict, camera_file):
    """The report without photographs."""
    return make_report(evaluation, verdict, provenance_of(camera_file))
