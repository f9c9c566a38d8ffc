"""Bad input: one clear sentence, the right exit status, nothing lost."""

from __future__ import annotations

import errno
import importlib
import io
import json
import os
import pickle
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from pinholify.corners import Corners
from pinholify.errors import UnsolvableError
from pinholify.geometry import Pose
from pinholify.io.corner_tables import write_corner_table
from pinholify.io.images import write_image
from small_camera import BOARD, FROM_TABLE, corner_set

CORNERS = ("--image-size", "640x480", "--board", "9x6", "--no-opencv")
MIDDLE = np.array([(BOARD.columns - 1) / 2, (BOARD.rows - 1) / 2, 0.0])


def grey(path, width=640, height=480):
    write_image(path, np.full((height, width), 120, np.uint8))
    return path


# --- images --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["detect", "calibrate"])
class TestImages:
    def test_none_in_the_folder(self, refused, command):
        Path("empty").mkdir()
        assert "'empty' holds no images; give one that does" in refused(command, "empty", "--board", "9x6")

    def test_no_such_file(self, refused, command):
        assert "there is no file 'missing.png'" in refused(command, "missing.png", "--board", "9x6")

    def test_no_board_in_any(self, refused, command):
        paths = [grey(Path(f"{i}.png")) for i in range(3)]
        sentence = refused(command, *paths, "--board", "9x6")
        assert "no 9x6 board was found in any of the 3 images" in sentence
        assert "check the board's size" in sentence

    def test_no_board_in_one(self, refused, command):
        assert "no 9x6 board was found in 'a.png'" in refused(command, grey(Path("a.png")), "--board", "9x6")

    def test_board_of_another_size(self, refused, command, photographs):
        paths = [photographs / "small-00.png", photographs / "small-01.png"]
        sentence = refused(command, *paths, "--board", "7x5")
        assert "no 7x5 board was found in any of the 2 images" in sentence
        assert "9x6" in sentence

    def test_mixed_sizes(self, refused, command, photographs):
        shutil.copy(photographs / "small-00.png", "a.png")
        sentence = refused(command, "a.png", grey(Path("b.png"), 320, 240), "--board", "9x6")
        assert "640x480" in sentence
        assert "'b.png' is 320x240; give images of one camera at one size" in sentence

    def test_too_large(self, refused, command):
        Image.new("1", (20_000, 10_000)).save("huge.png")
        sentence = refused(command, "huge.png", "--board", "9x6")
        assert "megapixels are read; give a smaller image" in sentence

    def test_one_pixel(self, refused, command):
        assert "only 1x1 px" in refused(command, grey(Path("dot.png"), 1, 1), "--board", "9x6")

    def test_same_image_twice(self, refused, command, photographs):
        path = photographs / "small-00.png"
        assert "is given twice; name each image once" in refused(command, path, path, "--board", "9x6")


def test_too_few_boards_among_images_without_one(refused, photographs):
    paths = [photographs / "small-00.png", photographs / "small-01.png", *(grey(Path(f"{i}.png")) for i in range(3))]
    sentence = refused("calibrate", *paths, "--board", "9x6")
    assert "a 9x6 board was found in 2 of the 5 images where 3 are needed (0.png, 1.png, 2.png: no board" in sentence


def test_board_smaller_than_said(refused, photographs):
    paths = [photographs / f"small-{i:02d}.png" for i in (0, 1, 2)]
    sentence = refused("calibrate", *paths, "--board", "12x9")
    assert "the board has 9x6 inner corners, not 12x9" in sentence


@pytest.fixture
def damaged(photographs):
    """Files that are no images, whatever they are called, and what is said of them."""
    whole = (photographs / "small-01.png").read_bytes()
    Path("cut.png").write_bytes(whole[: len(whole) // 2])
    Path("empty.jpg").write_bytes(b"")
    Path("text.jpg").write_text("no image\n")
    return {"cut.png": "cut short or damaged", "empty.jpg": "is empty", "text.jpg": "cannot be read as an image"}


@pytest.mark.parametrize("name", ["cut.png", "empty.jpg", "text.jpg"])
def test_damaged_image_alone(refused, damaged, name):
    assert damaged[name] in refused("calibrate", name, "--board", "9x6")


def test_damaged_images_among_good_ones_are_named_and_left_out(run, damaged, photographs):
    result = run("detect", photographs / "small-00.png", *damaged, "--board", "9x6", "--json")
    assert result.status == 0
    found = {image["file"]: image["found"] for image in json.loads(result.out)["images"]}
    assert found == {"small-00.png": True, "cut.png": False, "empty.jpg": False, "text.jpg": False}
    for name, reason in damaged.items():
        assert any(name in line and reason in line for line in result.err.splitlines())


def test_many_images_without_a_board_are_summed_up(run, photographs):
    paths = [grey(Path(f"grey{i}.png")) for i in range(9)]
    result = run("detect", photographs / "small-00.png", *paths, "--board", "9x6", "-o", "c.vnl")
    assert result.status == 0
    assert result.err.startswith("grey0.png, grey1.png, grey2.png, grey3.png and 5 more: no board")
    assert len(result.err.splitlines()) == 2  # and what was written


# --- cameras that cannot be judged ---------------------------------------------------------------------------


@pytest.mark.parametrize("step", ["evaluation.summary.evaluate", "evaluation.verdict.judge"])
def test_an_evaluation_without_a_solution_costs_no_camera(run, refused, table, monkeypatch, step):
    def unsolvable(*_, **__):
        raise UnsolvableError("equations without a solution")

    # Loaded for the first time by a command below, it would keep the patched function for all tests that follow.
    importlib.import_module("pinholify.report.evaluated")
    monkeypatch.setattr(f"pinholify.{step}", unsolvable)
    sentence = refused("calibrate", "--corners", table, *FROM_TABLE)
    assert sentence.startswith("wrote camera.npz, but could not evaluate it: ")
    assert "'pinholify evaluate camera.npz'" in sentence
    sentence = refused("evaluate", "camera.npz", "--corners", table, "--no-opencv")
    assert "equations without a solution" in sentence
    monkeypatch.undo()


# --- boards that do not determine a camera -------------------------------------------------------------------


def turned(reference: Pose, angles, shift) -> Pose:
    """``reference`` turned about its middle by ``angles`` (z, y, x; degrees), shifted in the camera frame."""
    rotation = reference.rotation @ Rotation.from_euler("zyx", angles, degrees=True).as_matrix()
    shift = np.array(shift, dtype=float)
    return Pose(rotation, reference.translation + (reference.rotation - rotation) @ MIDDLE + shift)


SHIFTS = [(0.3, 0.2, 2.5), (-0.4, 0.3, 3.5), (0.5, -0.4, 4), (-0.4, -0.2, 3), (0.1, 0.6, 4.5), (0.2, -0.1, 2.2)]


@pytest.mark.parametrize("method", ["one-image", "joint", "auto"])
@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("tilt", [0, 25], ids=["all parallel", "parallel in two groups"])
def test_boards_that_stand_alike(refused, poses, tilt, noise, method):
    others = [turned(poses[0], (4 * i, 0 if i % 2 else tilt, 0), shift) for i, shift in enumerate(SHIFTS)]
    write_corner_table("c.vnl", corner_set([poses[0], *others], noise=noise))
    sentence = refused("calibrate", "--corners", "c.vnl", *CORNERS, "--method", method, "-o", "c.npz")
    assert "do not determine f, uc and vc" in sentence
    assert "singular values" in sentence
    assert "tilted in at least two ways" in sentence
    assert not Path("c.npz").exists()


@pytest.mark.parametrize("method", ["one-image", "joint", "auto"])
def test_only_the_reference(refused, poses, method):
    write_corner_table("c.vnl", corner_set(poses[:1]))
    sentence = refused("calibrate", "--corners", "c.vnl", *CORNERS, "--method", method, "-o", "c.npz")
    assert "more" in sentence
    assert not Path("c.npz").exists()


def test_too_few_corners_on_the_reference(refused, poses):
    views = [view.select(np.arange(len(view)) < 12) for view in corner_set(poses).views]
    write_corner_table("c.vnl", corner_set(poses).with_views(views))
    assert "shows 12 corners" in refused("calibrate", "--corners", "c.vnl", *CORNERS)


def test_mirrored_corners_of_a_camera_that_looks_into_no_mirror(refused, poses):
    flipped = [Corners(v.name, v.ids, [639, 0] + v.uv * [-1, 1]) for v in corner_set(poses).views]
    write_corner_table("c.vnl", corner_set(poses).with_views(flipped))
    sentence = refused("calibrate", "--corners", "c.vnl", *CORNERS, "--method", "one-image")
    assert "set 'mirrored' if the camera looks into a mirror" in sentence


# --- corner tables -------------------------------------------------------------------------------------------


class TestTables:
    def test_wrong_count(self, refused, table):
        lines = table.read_text().splitlines()
        Path("short.vnl").write_text("\n".join(lines[:-1]))
        assert "has 53 lines where a 9x6 board needs 54" in refused("calibrate", "--corners", "short.vnl", *CORNERS)

    def test_other_board(self, refused, table):
        words = ("--image-size", "640x480", "--board", "15x9")
        assert "has 54 lines where a 15x9 board needs 135" in refused("calibrate", "--corners", table, *words)

    def test_no_such_table(self, refused):
        assert "there is no file 'no.vnl'" in refused("calibrate", "--corners", "no.vnl", *CORNERS)

    def test_no_table(self, refused, photographs):
        image = photographs / "small-00.png"
        assert "is not text" in refused("calibrate", "--corners", image, *CORNERS)

    def test_no_board_in_any(self, refused):
        Path("c.vnl").write_text("# filename x y level\na.png - - -\nb.png - - -\n")
        assert "no 9x6 board was found in any of the 2" in refused("calibrate", "--corners", "c.vnl", *CORNERS)

    def test_wrong_image_size(self, refused, table):
        sentence = refused("calibrate", "--corners", table, "--image-size", "64x48", "--board", "9x6")
        assert "outside an image of 64x48: give the size of the photographs with --image-size" in sentence

    def test_corners_on_a_line(self, refused, poses):
        views = [Corners(v.name, v.ids, v.uv[:, :1] * [1.0, 0.5]) for v in corner_set(poses).views]
        write_corner_table("c.vnl", corner_set(poses).with_views(views))
        assert "all 54 corners of 'a0.png' lie on one line" in refused("calibrate", "--corners", "c.vnl", *CORNERS)

    def test_reference_that_is_not_there(self, refused, table):
        sentence = refused("calibrate", "--corners", table, *CORNERS, "--reference", "b.png")
        assert "one of the 9 images, but 'b.png' is the name of none" in sentence

    def test_reference_that_is_two(self, refused, poses):
        corners = corner_set(poses[:2])
        twins = [Corners(f"{i}/a.png", v.ids, v.uv) for i, v in enumerate(corners.views)]
        write_corner_table("c.vnl", corners.with_views(twins))
        sentence = refused("calibrate", "--corners", "c.vnl", *CORNERS, "--reference", "a.png")
        assert "one of the 2 images, but 'a.png' is the name of 2" in sentence


# --- camera files --------------------------------------------------------------------------------------------


def not_a_camera(kind: str, camera: Path) -> bytes:
    whole, file = camera.read_bytes(), io.BytesIO()
    if kind == "cut":
        return whole[: len(whole) // 2]
    if kind == "pickle":
        return pickle.dumps({"f": 1.0})
    if kind == "pickled array":
        np.savez(file, header=np.array([{"format": "pinholify-camera"}], dtype=object))
    elif kind == "other archive":
        np.savez(file, numbers=np.zeros(3))
    elif kind == "bomb":
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("header.npy", "w") as entry:
            entry.write(bytes(1 << 21))
    elif kind == "text":
        return b"no camera\n"
    return file.getvalue()


@pytest.mark.parametrize("kind", ["empty", "text", "cut", "pickle", "pickled array", "other archive", "bomb"])
def test_file_that_is_no_camera(refused, camera, photographs, monkeypatch, kind):
    monkeypatch.setattr("pinholify.io.camera_file.MAX_BYTES", 1 << 20)
    Path("bad.npz").write_bytes(not_a_camera(kind, camera))
    for words in (["evaluate", "bad.npz", photographs], ["undistort", "bad.npz", photographs, "-o", "out"]):
        assert "'pinholify calibrate' wrote" in refused(*words)
    assert not Path("out").exists()


def test_camera_of_a_newer_version(refused, camera, photographs):
    with np.load(camera) as archive:
        arrays = dict(archive)
    header = json.loads(arrays["header"].tobytes())
    header["format_version"] = 99
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez("newer.npz", **arrays)
    sentence = refused("evaluate", "newer.npz", photographs)
    assert "format 99 and this pinholify reads 3: upgrade pinholify" in sentence


def test_camera_that_is_not_there(refused, photographs):
    assert "there is no camera file 'no.npz'" in refused("evaluate", "no.npz", photographs)


def test_camera_that_is_a_folder(refused, photographs):
    assert "is a folder" in refused("evaluate", photographs, photographs)


def test_images_of_another_size_than_the_camera(refused, run, camera, photographs):
    grey(Path("a.png"), 320, 240)
    assert "'a.png': the image is 320x240" in refused("undistort", camera, "a.png", "-o", "out")
    assert list(Path("out").iterdir()) == []
    result = run("undistort", camera, photographs / "small-00.png", "a.png", "-o", "out")
    assert result.status == 1
    assert "1 of 2 images could not be straightened: 'a.png'" in result.sentence
    assert [p.name for p in Path("out").iterdir()] == ["small-00.png"]


def test_photographs_of_another_size_are_refused_before_boards_are_looked_for(refused, camera):
    image = Path("a.png")
    rng = np.random.default_rng(0)
    write_image(image, rng.integers(0, 255, (240, 320), dtype=np.uint8))
    assert "the images are 320x240 px, but" in refused("evaluate", camera, image)


# --- where results go ----------------------------------------------------------------------------------------


def writers(camera, photographs, table):
    """Every command that writes a file, up to the name of it."""
    Path("points.csv").write_text("u,v\n1,2\n")
    return {
        "calibrate": ["calibrate", "--corners", table, *FROM_TABLE, "-o"],
        "detect": ["detect", photographs / "small-00.png", "--board", "9x6", "-o"],
        "map": ["map", camera, "points.csv", "--to", "rays", "-o"],
        "board": ["board", "9x6", "--square", "20mm", "-o"],
    }


WRITERS = ("calibrate", "detect", "map", "board")


@pytest.mark.parametrize("command", WRITERS)
@pytest.mark.parametrize(
    ("output", "reason"),
    [
        ("nowhere/out.pdf", "its folder does not exist"),
        ("folder.pdf", "it is a folder; name a file in it"),
        ("file.txt/out.pdf", "is a file, not a folder"),
        ("/dev/full", "it is a device"),
    ],
)
def test_output_that_cannot_be_written(refused, camera, photographs, table, command, output, reason):
    Path("folder.pdf").mkdir()
    Path("file.txt").write_text("mine\n")
    sentence = refused(*writers(camera, photographs, table)[command], output)
    assert f"'{output}' cannot be written" in sentence
    assert reason in sentence


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_output_folder_without_permission(refused, camera, photographs):
    Path("locked").mkdir(mode=0o500)
    assert "permission is denied" in refused("undistort", camera, photographs, "-o", "locked")


def ending(command):
    """Cameras go into files called so; other results into any."""
    return ".npz" if command == "calibrate" else ".pdf"


@pytest.mark.parametrize("command", WRITERS)
def test_something_else_is_replaced_only_by_force(refused, run, camera, photographs, table, command):
    output = Path(f"precious{ending(command)}")
    output.write_text("mine\n")
    words = writers(camera, photographs, table)[command]
    assert f"'{output}' is already there" in refused(*words, output)
    assert output.read_text() == "mine\n"
    assert run(*words, output, "--force").status == 0
    assert output.read_bytes() != b"mine\n"


@pytest.mark.parametrize("command", ["calibrate", "detect", "map"])
def test_an_earlier_result_is_replaced(run, camera, photographs, table, command):
    words = writers(camera, photographs, table)[command]
    assert run(*words, f"out{ending(command)}").status == run(*words, f"out{ending(command)}").status == 0


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_no_input_is_ever_replaced(refused, camera, photographs, table, force):
    shutil.copy(table, "c.vnl")
    shutil.copytree(photographs, "photos")
    shutil.copy(camera, "camera.npz")
    Path("points.csv").write_text("u,v\n1,2\n")
    before = {p: p.read_bytes() for p in Path().rglob("*") if p.is_file()}
    words = [
        ["calibrate", "--corners", "c.vnl", *FROM_TABLE, "-o", "./c.vnl"],
        ["calibrate", "photos", "--board", "9x6", "-o", "photos/small-00.png"],
        ["detect", "photos", "--board", "9x6", "-o", "photos/small-00.png"],
        ["map", "camera.npz", "points.csv", "--to", "rays", "-o", "./points.csv"],
        ["map", "camera.npz", "points.csv", "--to", "rays", "-o", "camera.npz"],
    ]
    for command in words:
        assert "is one of the inputs; write to another file" in refused(*command, *force)
    sentence = refused("undistort", "camera.npz", "photos", "-o", "photos", *force)
    assert "would replace the photographs themselves" in sentence
    assert {p: p.read_bytes() for p in Path().rglob("*") if p.is_file()} == before


def test_two_inputs_with_one_output(refused, camera, photographs):
    for folder in ("one", "two"):
        Path(folder).mkdir()
        shutil.copy(photographs / "small-00.png", folder)
    sentence = refused("undistort", camera, "one", "two", "-o", "out")
    assert "two images would both be written as 'out/small-00.png'" in sentence
    assert not Path("out").exists()


def test_straightened_images_are_replaced_only_by_force(refused, run, camera, photographs):
    image, output = photographs / "small-00.png", Path("out/small-00.png")
    output.parent.mkdir()
    output.write_text("mine\n")
    assert "is already there" in refused("undistort", camera, photographs, "-o", "out")
    assert [p.name for p in output.parent.iterdir()] == [output.name]
    assert output.read_text() == "mine\n"
    assert run("undistort", camera, image, "-o", "out", "--force").status == 0


def test_folder_that_cannot_be_made(refused, camera, photographs):
    Path("file").write_text("mine\n")
    assert "the folder 'file' cannot be created" in refused("undistort", camera, photographs, "-o", "file")
    assert "cannot be created" in refused("demo", "-o", "file/out")
    assert "cannot be created" in refused("simulate", "webcam", "-o", "file", "--views", "1")


def test_demo_leaves_folders_with_other_things_alone(refused):
    Path("mine").mkdir()
    Path("mine/street.jpg").write_text("mine\n")
    assert "the folder 'mine' holds other files" in refused("demo", "-o", "mine")
    assert Path("mine/street.jpg").read_text() == "mine\n"


def test_simulated_folder_is_replaced_only_by_force(refused):
    Path("data/webcam").mkdir(parents=True)
    assert "'data/webcam' is already there" in refused("simulate", "webcam", "-o", "data")


@pytest.mark.parametrize("command", ["calibrate", "detect", "map"])
def test_full_disk(refused, camera, photographs, table, monkeypatch, command):
    words = writers(camera, photographs, table)[command]

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "replace", full)
    output = Path(f"out{ending(command)}")
    assert f"'{output}' cannot be written: the disk is full" in refused(*words, output)
    assert not output.exists()


def test_full_disk_while_straightening(refused, camera, photographs, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    assert "the disk is full" in refused("undistort", camera, photographs, "-o", "out")
    assert list(Path("out").iterdir()) == []


def test_result_too_large(refused, camera, photographs):
    sentence = refused("undistort", camera, photographs, "-o", "out", "--size", "40000x40000")
    assert "choose a smaller size" in sentence
    assert not Path("out").exists()


def test_std_limit_nobody_can_keep(refused, camera, photographs):
    sentence = refused("undistort", camera, photographs, "-o", "out", "--max-std", "1e-9")
    assert "allow a larger one" in sentence


# --- wrong usage ---------------------------------------------------------------------------------------------

USAGE = {
    "no command": ([], "Usage:"),
    "unknown command": (["frobnicate"], "No such command"),
    "unknown option": (["board", "9x6", "--colour"], "No such option"),
    "neither images nor table": (["calibrate", "--board", "9x6"], "give either IMAGES or --corners FILE"),
    "images and table": (["calibrate", "a.png", "--corners", "c.vnl", "--board", "9x6"], "give either IMAGES"),
    "table without size": (["calibrate", "--corners", "c.vnl", "--board", "9x6"], "--corners needs --image-size"),
    "size without table": (["calibrate", "a.png", "--board", "9x6", "--image-size", "4x3"], "goes with --corners"),
    "no board": (["calibrate", "a.png"], "Missing option '--board'"),
    "board of letters": (["detect", "a.png", "--board", "big"], "'big' is not a board; write"),
    "board too small": (["detect", "a.png", "--board", "2x2"], "at least 3x3 are needed"),
    "unknown kind of board": (["detect", "a.png", "--board", "hexagons:3"], "unknown kind of board"),
    "unknown kernel": (["calibrate", "a.png", "--board", "9x6", "--kernel", "k"], "'k'"),
    "unknown trend": (["calibrate", "a.png", "--board", "9x6", "--trend", "t"], "unknown trend 't'"),
    "trend of the other method": (
        ["calibrate", "a.png", "--board", "9x6", "--method", "joint", "--trend", "constant"],
        "the joint refinement has no trend 'constant'",
    ),
    "unknown method": (["calibrate", "a.png", "--board", "9x6", "--method", "m"], "is not one of"),
    "no square": (["board", "9x6"], "Missing option '--square'"),
    "square of nothing": (["board", "9x6", "--square", "0mm"], "invalid length '0mm': write"),
    "size of letters": (["undistort", "c.npz", "a.png", "-o", "d", "--size", "big"], "invalid size 'big': write"),
    "negative limit": (["undistort", "c.npz", "a.png", "-o", "d", "--max-std", "-1"], "--max-std"),
    "no images to straighten": (["undistort", "c.npz", "-o", "d"], "Missing argument"),
    "no target": (["map", "c.npz", "-"], "Missing option '--to'"),
    "unknown target": (["map", "c.npz", "-", "--to", "space"], "is not one of"),
    "unknown data set": (["simulate", "moon", "-o", "d"], "unknown data set 'moon': choose one of all"),
}


@pytest.mark.parametrize(("words", "reason"), USAGE.values(), ids=USAGE)
def test_wrong_usage(run, words, reason):
    result = run(*words)
    assert result.status == 2
    assert reason in result.err
    assert result.out == ""
    assert list(Path().iterdir()) == []


