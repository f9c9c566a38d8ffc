"""``pinholify report`` and ``calibrate --report``; the lines it offers for copying run."""

import dataclasses
import json
import os
import shlex
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pinholify.cli import main
from pinholify.io.camera_file import write_camera
from pinholify.io.corner_tables import write_corner_table
from pinholify.report.usage import snippets
from small_camera import FROM_TABLE, SIZE, corner_set

QUICK = ("--no-opencv", "--no-heldout")


@pytest.fixture(autouse=True)
def in_own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def run(capsys):
    """Runs ``pinholify``; its status and what it printed on both streams."""

    def command(*words):
        capsys.readouterr()
        status = main([str(word) for word in words])
        return status, *capsys.readouterr()

    return command


@pytest.fixture
def lonely(camera_file):
    """The camera file in the current folder, its photographs elsewhere."""
    return shutil.copy(camera_file, "camera.npz")


def test_a_report_of_a_camera_and_its_photographs(run, camera_file, folder, tmp_path):
    status, out, err = run("report", camera_file, folder / "a0.png", folder / "a2.png", *QUICK, "-o", "r.html")
    assert (status, out) == (0, "wrote r.html\n")
    assert "8 of the 10 photographs are missing" in err
    assert (tmp_path / "r.html").read_text(encoding="utf-8").count("data:image/jpeg") == 3


def test_photographs_are_found_beside_the_camera(run, camera_file, tmp_path):
    _, _, err = run("report", camera_file, *QUICK, "-o", "r.html")
    assert "photographs" not in err
    assert (tmp_path / "r.html").read_text(encoding="utf-8").count("data:image/webp") == 2


@pytest.mark.parametrize(
    ("options", "name", "start"),
    [
        (["-o", "r.md"], "r.md", "<!-- pinholify-report"),
        (["-o", "r.txt", "--format", "md"], "r.txt", "<!-- pinholify-report"),
        ([], "report.html", "<!doctype html>"),
    ],
)
def test_the_format_is_the_one_asked_for_or_the_files(run, lonely, tmp_path, options, name, start):
    assert run("report", lonely, *QUICK, *options)[0] == 0
    assert (tmp_path / name).read_text(encoding="utf-8").startswith(start)


def test_json_goes_to_standard_output_and_no_file_is_written(run, lonely, tmp_path):
    status, out, err = run("report", lonely, *QUICK, "--json")
    assert (status, err) == (0, "")
    assert json.loads(out)["provenance"]["file"] == "camera.npz"
    assert list(tmp_path.iterdir()) == [tmp_path / "camera.npz"]


@pytest.mark.parametrize(
    ("form", "start"), [("html", "<!DOCTYPE html>"), ("md", "<!-- pinholify-report"), ("json", "{")]
)
def test_a_report_goes_to_standard_output(run, lonely, tmp_path, form, start):
    status, out, err = run("report", "camera.npz", *QUICK, "--format", form, "-o", "-")
    assert status == 0
    assert out.lower().startswith(start.lower())
    assert "wrote" not in out
    assert "note: " in err
    assert [path.name for path in tmp_path.iterdir()] == ["camera.npz"]


def test_standard_output_holds_one_thing(lonely):
    Path("a.png").write_bytes(b"a picture")
    assert main(["report", "camera.npz", "--json", "-o", "-"]) == 2
    assert main(["calibrate", "a.png", "--board", "9x6", "--report", "-", "-o", "b.npz"]) == 2


def test_heldout_error_and_models_are_compared(run, lonely):
    data = json.loads(run("report", lonely, "--json")[1])
    assert data["comparison"]["heldout_px"] < data["comparison"]["models"]["opencv5"]["heldout_px"] * 5
    assert len(data["missing"]) == 1  # the photographs


def test_an_earlier_report_is_replaced_and_nothing_else(run, lonely, tmp_path):
    for _ in range(2):
        assert run("report", lonely, *QUICK, "-o", "r.md")[0] == 0
    (tmp_path / "diary.html").write_text("my page")
    status, _, err = run("report", lonely, *QUICK, "-o", "diary.html")
    assert status == 1
    assert "already there" in err
    assert (tmp_path / "diary.html").read_text() == "my page"
    assert run("report", lonely, *QUICK, "-o", "diary.html", "--force")[0] == 0


def test_a_report_has_a_known_ending(run, lonely, tmp_path):
    status, _, err = run("report", lonely, *QUICK, "-o", "r.pdf")
    assert status == 1
    assert ".html or .md or .json" in err
    assert not (tmp_path / "r.pdf").exists()


def test_the_camera_is_never_overwritten(run, lonely, tmp_path):
    before = (tmp_path / "camera.npz").read_bytes()
    status, _, err = run("report", "camera.npz", *QUICK, "-o", "./camera.npz", "--force")
    assert status == 1
    assert len(err.splitlines()) == 1
    assert (tmp_path / "camera.npz").read_bytes() == before


@pytest.mark.parametrize("name", ["missing.npz", "text.npz"])
def test_a_file_that_is_no_camera_is_refused_in_a_sentence(run, tmp_path, name):
    (tmp_path / "text.npz").write_text("hello")
    status, _, err = run("report", name)
    assert status == 1
    assert len(err.splitlines()) == 1


def test_a_camera_without_corners_is_refused_with_what_to_do_instead(run, evaluation, corners):
    write_camera("bare.npz", dataclasses.replace(evaluation.calibration, corner_set=corners.with_views(())))
    status, _, err = run("report", "bare.npz")
    assert status == 1
    assert "holds no corners" in err
    assert "pinholify evaluate" in err
    assert len(err.splitlines()) == 1


def test_calibrate_writes_a_report_too(run, poses, tmp_path):
    write_corner_table(tmp_path / "corners.vnl", corner_set(poses))
    words = ("calibrate", "--corners", "corners.vnl", *FROM_TABLE, "--no-heldout", "-o", "camera.npz")
    status, out, err = run(*words, "--report", "r.html")
    assert status == 0
    assert out.endswith("wrote camera.npz\nwrote r.html\n")
    assert "photographs were not available" in err
    assert "camera.npz" in (tmp_path / "r.html").read_text(encoding="utf-8")
    assert json.loads(run(*words, "--report", "r.html", "--json")[1])["format_version"] == 1


def test_calibrate_refuses_one_file_for_camera_and_report_before_work(run, poses, tmp_path):
    write_corner_table(tmp_path / "corners.vnl", corner_set(poses))
    words = ("calibrate", "--corners", "corners.vnl", *FROM_TABLE, "-o", "c.npz")
    status, _, err = run(*words, "--report", "c.npz")
    assert status == 1
    assert "the report 'c.npz' would replace" in err
    assert not (tmp_path / "c.npz").exists()


@pytest.mark.parametrize("index", [0, 1, 2])
def test_the_python_lines_run_on_this_very_file(camera_file, folder, tmp_path, index):
    shutil.copy(camera_file, tmp_path)
    shutil.copy(folder / "a0.png", tmp_path / "photo.jpg")
    names = {}
    exec(snippets(camera_file.name, SIZE)[index].text, names)
    if "pixels" in names:
        assert names["camera"].project(names["rays"].directions) == pytest.approx(names["pixels"], abs=1e-3)
    else:
        assert names["straight"].shape == (SIZE[1], SIZE[0], 3)


def test_the_shell_lines_run_on_this_very_file(run, camera_file, folder, tmp_path):
    shutil.copy(camera_file, tmp_path)
    for place in ("photos", "new-photos"):
        (tmp_path / place).mkdir()
    shutil.copy(folder / "a0.png", tmp_path / "photos" / "a0.png")
    (tmp_path / "points.csv").write_text("u,v\n10,20\n")
    *lines, evaluate = snippets(camera_file.name, SIZE)[3].text.splitlines()
    for line in lines:
        assert run(*shlex.split(line)[1:])[0] == 0, line
    assert shlex.split(evaluate) == ["pinholify", "evaluate", camera_file.name, "new-photos/"]


@pytest.mark.parametrize("name", ["a b.npz", "-x.npz", "q'\"\\.npz", "{0}.npz", "é\n.npz"])
def test_the_lines_hold_any_name(name):
    for snippet in snippets(name, SIZE)[:3]:
        call = next(line for line in snippet.text.splitlines() if "read_camera(" in line)
        literal = call.split("read_camera(", 1)[1].rsplit(")", 1)[0]
        assert eval(literal) == name
    words = shlex.split(snippets(name, SIZE)[3].text.splitlines()[0] if "\n" not in name else "x x './é\n.npz'")
    assert words[2] in (name, f"./{name}")
    assert not words[2].startswith("-")


@pytest.mark.slow
def test_the_pages_parts_are_in_the_wheel(tmp_path):
    pytest.importorskip("hatchling", reason="hatchling builds the wheel; it is not installed")
    root = os.path.join(os.path.dirname(__file__), "..", "..")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=root, check=True, capture_output=True, timeout=120)
    (wheel,) = tmp_path.glob("*.whl")
    inside = zipfile.ZipFile(wheel).namelist()
    for name in ("page.html", "style.css", "slider.js", "scene.js", "copy.js"):
        assert f"pinholify/report/assets/{name}" in inside


def test_joint_cameras_are_told_too(run, poses, tmp_path):
    write_corner_table(tmp_path / "corners.vnl", corner_set(poses))
    words = ("calibrate", "--corners", "corners.vnl", "--board", "9x6", "--image-size", "640x480", "--method", "joint",
             "--trend", "plane:1", "--no-opencv", "--no-heldout", "--report", "r.json")
    assert run(*words)[0] == 0
    data = json.loads((tmp_path / "r.json").read_text())
    assert data["model"]["method"] == "joint"
    assert np.array(data["coverage"]["next_board"]).shape == (4, 2)
    assert data["overview"]["advice"]
