"""``pinholify export``: what it writes, says and refuses."""

from __future__ import annotations

import resource

import pytest

from pinholify.cli import main
from pinholify.io.camera_file import write_camera
from pinholify.io.export import FORMATS, format_named
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
    assert "% of the view shows nothing that may be believed" in err or not form.of_view
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
        (("--format", "ros", "-o", "a.txt"), "ends in '.txt' where this format ends in .yaml or .yml"),
        (("--format", "ros", "-o", "no/a.yaml"), "its folder does not exist"),
        (("--format", "mrcal-splined", "--size", "96x72", "-o", "a.cameramodel"), "leave the size out"),
        (("--format", "npy", "--size", "40000x10", "-o", "a.npy"), "choose a smaller size"),
        (("--format", "npy", "--max-std", "1e-9", "-o", "a.npy"), "allow more with --max-std"),
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
