"""``pinholify export``: what it writes, says and refuses."""

from __future__ import annotations

import json
import re
import resource

import cv2
import numpy as np
import pytest

from pinholify.cli import main
from pinholify.io.camera_file import write_camera
from pinholify.io.export import FORMATS, format_named
from pinholify.io.images import read_image, write_image
from tilted import tilted_calibration


@pytest.fixture(scope="module")
def camera(tmp_path_factory):
    path = tmp_path_factory.mktemp("camera") / "camera.npz"
    write_camera(path, tilted_calibration())
    return path


@pytest.fixture
def run(capsys, camera, tmp_path, monkeypatch):
    """Runs the command on the camera in a folder of its own: status, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def command(*words):
        try:
            status = main(["export", str(camera), *words])
        except SystemExit as end:
            status = int(end.code or 0)
        return status, *capsys.readouterr()

    return command


@pytest.mark.parametrize("name", FORMATS)
def test_every_format(run, tmp_path, name):
    form = format_named(name)
    path = tmp_path / f"out{form.suffixes[0]}"
    size = ("--size", "96x72") if form.of_view else ()
    status, out, err = run("--format", name, *size, "-o", path.name)
    assert status == 0
    assert sorted(tmp_path.iterdir()) == sorted(form.files(path))
    what = "view 'camera'" if form.of_view else "the camera"
    assert out == f"wrote {' and '.join(p.name for p in form.files(path))}: {what} for {name}\n"
    assert "% of the view shows nothing that can be trusted" in err or not form.of_view
    assert form.lost in err


@pytest.mark.parametrize("name", FORMATS)
def test_files_that_cannot_be_written_to_their_end_are_not_there(run, tmp_path, name):
    form = format_named(name)
    path = tmp_path / f"out{form.suffixes[-1]}"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, limits[1]))  # bytes of a file: as good as a disk that is full
    try:
        status, _, err = run("--format", name, "-o", path.name)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert status == 1
    assert err.endswith("cannot be written: File too large; choose another place\n")
    assert not list(tmp_path.iterdir())


def test_a_view_of_choice(run, tmp_path):
    assert run("--format", "ros", "--view", "board", "--size", "96x72", "--max-std", "0.5", "-o", "a.yaml")[0] == 0
    text = (tmp_path / "a.yaml").read_text()
    assert "camera_name: pinholify_board" in text
    assert "image_width: 96" in text
    assert "--view board --size 96x72 --max-std 0.5 -o" in text


@pytest.mark.parametrize(
    "options",
    [("--keep", "valid"), ("--fov", "35", "--turn", "5,-2.5,90"), ("--turn", "-3"), ("--view", "cube-front")],
)
def test_k_is_that_of_the_pictures_made_with_the_command_it_states(run, camera, tmp_path, capsys, options):
    assert run("--format", "opencv", *options, "-o", "a.yaml")[0] == 0
    model = cv2.FileStorage("a.yaml", cv2.FILE_STORAGE_READ)
    command = re.search(r"undistort CAMERA IMAGES (.*) -o FOLDER", (tmp_path / "a.yaml").read_text())[1]
    write_image("photo.png", np.full((480, 640), 200, np.uint8))
    assert main(["undistort", str(camera), "photo.png", *command.split(), "-o", "out", "--json"]) == 0
    view = json.loads(capsys.readouterr().out)["view"]
    np.testing.assert_allclose(view["k"], model.getNode("camera_matrix").mat(), rtol=1e-12)
    np.testing.assert_allclose(view["rotation"], model.getNode("rotation").mat(), atol=1e-12)
    assert read_image("out/photo.png").shape == tuple(view["size"][::-1])


@pytest.mark.parametrize("options", [("--fov", "30"), ("--turn", "40")])
def test_what_lies_outside_the_view_is_said(run, options):
    share = r"note: \d+\.\d % of the trusted part of the original image lies outside the view\n"
    assert re.search(share, run("--format", "ros", *options, "-o", "a.yaml")[2])
    assert not re.search(share, run("--format", "ros", "-o", "b.yaml")[2])


def test_a_file_that_is_there_is_kept_unless_forced(run, tmp_path):
    mine = tmp_path / "a-maps.yaml"
    mine.write_text("mine")
    words = ("--format", "opencv", "--size", "96x72", "-o", "a.yaml")
    status, _, err = run(*words)
    assert (status, mine.read_text()) == (1, "mine")
    assert err.startswith("pinholify: 'a-maps.yaml' is already there")
    assert err.count("\n") == 1
    assert not (tmp_path / "a.yaml").exists()
    assert run(*words, "--force")[0] == 0
    assert mine.read_text() != "mine"


def test_the_camera_itself_is_never_replaced(run, camera, tmp_path):
    before = camera.read_bytes()
    link = tmp_path / "camera.npy"
    link.symlink_to(camera)
    status, _, err = run("--format", "npy", "-o", "camera.npy", "--force")
    assert status == 1
    assert "is one of the inputs" in err
    assert camera.read_bytes() == before


def test_unknown_formats_are_wrong_usage(run):
    status, _, err = run("--format", "agisoft", "-o", "a.xml")
    assert status == 2
    assert "'agisoft' is not one of 'colmap', 'colmap-simple'" in err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--format", "ros", "-o", "a.txt"), "ends in '.txt', but files of this format end in .yaml or .yml"),
        (("--format", "ros", "-o", "no/a.yaml"), "its folder does not exist"),
        (("--format", "mrcal-splined", "--size", "96x72", "-o", "a.cameramodel"), "omit size, fov and keep"),
        (("--format", "mrcal-splined", "--keep", "valid", "-o", "a.cameramodel"), "omit size, fov and keep"),
        (("--format", "ros", "--fov", "40", "--turn", "180", "-o", "a.yaml"), "looks away from everything"),
        (("--format", "ros", "--fov", "40", "--keep", "valid", "-o", "a.yaml"), "cannot both be given"),
        (("--format", "npy", "--size", "40000x10", "-o", "a.npy"), "choose a smaller size"),
        (("--format", "npy", "--max-std", "1e-9", "-o", "a.npy"), "allow a larger one"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(run, tmp_path, words, sentence):
    status, out, err = run(*words)
    assert (status, out) == (1, "")
    assert sentence in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_help_lists_all_formats(run):
    status, out, _ = run("--help")
    assert status == 0
    for name, title in FORMATS.items():
        assert f"{name} " in out
        assert title in out
