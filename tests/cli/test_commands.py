"""Every command on good input: what it writes, its JSON object, its columns."""

from __future__ import annotations

import io
import json
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pinholify.board import lattice, size
from pinholify.detection import detect_files
from pinholify.evaluation.measures import board_lines
from pinholify.evaluation.summary import evaluate
from pinholify.io.camera_file import read_camera
from pinholify.io.corner_tables import read_corner_table, write_corner_table
from pinholify.io.images import read_image, write_image
from small_camera import BOARD, FROM_TABLE, LENS, SIZE, SMALL, corner_set

EVALUATION_KEYS = {
    "format_version", "method", "kernel", "trend", "f", "uc", "vc", "f_std", "uc_std", "vc_std", "reference",
    "mirrored", "boards", "ce", "re_percent", "re_refined_percent", "pinholeness", "noise_px", "heldout_px", "opencv",
}  # fmt: skip
BOARD_KEYS = {"file", "used", "reason", "corners", "inside", "ce", "re_percent", "re_refined_percent"}
OPENCV_KEYS = {"insample_px", "re_percent", "heldout_px"}


def check_evaluation(data):
    """The object that ``calibrate --json`` and ``evaluate --json`` promise."""
    assert set(data) >= EVALUATION_KEYS
    assert data["format_version"] == 1
    assert all(set(board) >= BOARD_KEYS for board in data["boards"])
    assert all(set(model) == OPENCV_KEYS for model in data["opencv"].values())
    numbers = ("f", "uc", "vc", "f_std", "uc_std", "vc_std", "ce", "re_percent", "re_refined_percent", "noise_px")
    assert all(isinstance(data[key], float) for key in numbers)
    assert data["mirrored"] is False


def truth():
    return np.array(SMALL.truth().virtual_camera)


# --- detect --------------------------------------------------------------------------------------------------


def test_detect_writes_a_table_of_all_images(run, photographs):
    write_image("grey.png", np.full((480, 640), 120, np.uint8))
    paths = [photographs / f"small-{i:02d}.png" for i in range(3)]
    result = run("detect", *paths, "grey.png", "--board", "9x6", "-o", "c.vnl", "--workers", "2")
    assert result.status == 0
    assert result.out == ""
    corners = read_corner_table("c.vnl", board=BOARD, image_size=SIZE)
    assert [v.name for v in corners.views] == [*(path.name for path in paths), "grey.png"]
    assert [v.found for v in corners.views] == [True] * 3 + [False]
    for view, picture in zip(corners.views, SMALL.photographs(3), strict=False):
        assert np.abs(view.uv - picture.corners[view.ids]).max() < 0.3


def test_detect_prints_the_table_where_no_file_is_named(run, photographs):
    result = run("detect", photographs / "small-00.png", "--board", "9x6")
    corners = read_corner_table(io.StringIO(result.out), board=BOARD, image_size=SIZE)
    assert len(corners.views[0]) == size(BOARD)


def test_detect_json(run, photographs):
    write_image("grey.png", np.full((480, 640), 120, np.uint8))
    result = run("detect", photographs / "small-00.png", "grey.png", "--board", "9x6", "--json", "-o", "c.vnl")
    data = json.loads(result.out)
    assert data["board"] == "9x6"
    assert data["image_size"] == [640, 480]
    first, second = data["images"]
    assert first == {
        "file": "small-00.png",
        "found": True,
        "corners": 54,
        "reason": "",
        "orientation": "known",
        "ambiguous_offset": False,
    }
    assert second["found"] is False
    assert second["corners"] == 0
    assert second["reason"]
    assert Path("c.vnl").exists()


# --- calibrate and evaluate ----------------------------------------------------------------------------------


def test_calibrate_photographs_then_evaluate_them(run, photographs):
    words = ["--board", "9x6", "--method", "one-image", "-o", "camera.npz", "--json", "--square", "25mm"]
    result = run("calibrate", photographs, *words, "--reference", "small-00.png")
    assert result.status == 0
    data = json.loads(result.out)
    check_evaluation(data)
    assert data["reference"] == "small-00.png"
    assert data["method"] == "one-image"
    assert [board["file"] for board in data["boards"]] == [f"small-{i:02d}.png" for i in range(7)]
    assert np.abs([data["f"], data["uc"], data["vc"]] - truth()).max() < 0.01
    assert data["square_mm"] == 25.0
    assert set(data["opencv"]) == {"opencv5", "opencv8", "fisheye"}
    assert data["heldout_px"] < 0.1
    again = run("evaluate", "camera.npz", photographs, "--json")
    assert again.status == 0
    assert set(json.loads(again.out)) == set(data)
    check_evaluation(json.loads(again.out))
    assert json.loads(again.out)["ce"] == pytest.approx(data["ce"])


def test_joint_is_the_default_from_four_boards_on(run, table):
    result = run("calibrate", "--corners", table, "--image-size", "640x480", "--board", "9x6", "--no-opencv", "--json")
    data = json.loads(result.out)
    check_evaluation(data)
    assert data["method"] == "joint"
    assert data["opencv"] == {}
    assert read_camera("camera.npz").method == "joint"


@pytest.mark.parametrize(("trend", "method"), [("constant", "one-image"), ("plane:1", "joint")])
def test_a_trend_that_only_one_method_knows_chooses_it(run, table, trend, method):
    words = ["--image-size", "640x480", "--board", "9x6", "--no-opencv", "--json", "--trend", trend]
    assert json.loads(run("calibrate", "--corners", table, *words).out)["method"] == method


def test_corners_from_standard_input(run, table, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO(table.read_text()))
    result = run("calibrate", "--corners", "-", *FROM_TABLE, "-o", "camera.npz")
    assert result.status == 0
    assert [v.name for v in read_camera("camera.npz").corner_set.views] == [f"a{i}.png" for i in range(9)]


def test_reference_by_the_last_part_of_its_name(run, table):
    result = run("calibrate", "--corners", table, *FROM_TABLE, "--reference", "folder/a0.png", "--json")
    assert json.loads(result.out)["reference"] == "a0.png"


def test_a_board_counted_the_other_way_round_is_renumbered_and_named(run, poses):
    right = corner_set(poses)
    clean = run_json(run, right)
    turned = replace(right.views[2], ids=right.views[2].ids.reshape(6, 9)[:, ::-1].ravel())
    spoilt = run_json(run, right.with_views([turned if v.name == turned.name else v for v in right.views]))
    note = "numbered the other way round (columns reversed)"
    assert [board["note"] for board in spoilt["boards"]] == ["", "", note, *[""] * (len(right.views) - 3)]
    assert [board["used"] for board in spoilt["boards"]] == [board["used"] for board in clean["boards"]]
    assert (spoilt["f"], spoilt["heldout_px"]) == pytest.approx((clean["f"], clean["heldout_px"]), rel=1e-9)
    said = run("calibrate", "--corners", "c.vnl", *FROM_TABLE, "--report", "r.md", "--force")
    assert f"{turned.name} was {note}" in said.out
    assert note in Path("r.md").read_text()
    both = [replace(v, ids=v.ids.reshape(6, 9)[:, ::-1].ravel()) for v in right.views[2:4]]
    write_corner_table("c.vnl", right.with_views([*right.views[:2], *both, *right.views[4:]]))
    said = run("calibrate", "--corners", "c.vnl", *FROM_TABLE, "--force")
    assert f"2 boards were {note}: {both[0].name}, {both[1].name}" in said.out.replace("\n", " ")


def run_json(run, corners):
    """What ``calibrate --json`` says of ``corners``, written to c.vnl."""
    write_corner_table("c.vnl", corners)
    result = run("calibrate", "--corners", "c.vnl", *FROM_TABLE, "--json", "--force")
    assert result.status == 0
    return json.loads(result.out)


def test_mirrored_camera(run, poses):
    corners = corner_set(poses)
    flipped = [type(v)(v.name, v.ids, [639, 0] + v.uv * [-1, 1]) for v in corners.views]
    write_corner_table("c.vnl", corners.with_views(flipped))
    result = run("calibrate", "--corners", "c.vnl", *FROM_TABLE, "--mirrored", "--json")
    assert result.status == 0
    data = json.loads(result.out)
    assert data["mirrored"] is True
    assert data["f"] == pytest.approx(truth()[0], abs=0.02)


def test_folds(run, camera, table):
    result = run("evaluate", camera, "--corners", table, "--no-opencv", "--json", "--folds")
    assert 0.05 < json.loads(result.out)["heldout_kfold_px"] < 0.1


def test_what_does_not_exist_is_null(run, poses):
    write_corner_table("c.vnl", corner_set(poses[:3]))
    result = run("calibrate", "--corners", "c.vnl", *FROM_TABLE, "--json")
    assert result.status == 0
    assert json.loads(result.out, parse_constant=pytest.fail)["heldout_px"] is None


# --- text for people -----------------------------------------------------------------------------------------


def test_text_fits_eighty_columns_and_has_no_colours_in_a_pipe(run, table, camera):
    result = run("evaluate", camera, "--corners", table)
    lines = result.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "\x1b" not in result.out
    assert lines[0] == "one-image camera from a0.png: 8 of 9 boards count (9 images)"
    assert any(line.startswith("  f            4.9") for line in lines)


def test_text_is_never_broken_and_names_are_never_markup(run, poses):
    corners = corner_set(poses)
    name = "[/red]" + "x" * 90 + "[bold].png"
    views = [type(v)(name if i == 0 else v.name, v.ids, v.uv) for i, v in enumerate(corners.views)]
    write_corner_table("c.vnl", corners.with_views(views))
    result = run("calibrate", "--corners", "c.vnl", *FROM_TABLE)
    assert result.status == 0
    assert f"one-image camera from {name}: 8 of 9 boards count (9 images)" in result.out.splitlines()


def test_many_boards_that_do_not_count_are_summed_up(run, poses):
    corners = corner_set(poses)
    stray = [type(v)(f"stray{i}{v.name}", v.ids, v.uv) for i in range(12) for v in [corners.views[5]]]
    write_corner_table("c.vnl", corners.with_views([*corners.views, *stray]))
    result = run("calibrate", "--corners", "c.vnl", *FROM_TABLE)
    aside = [line for line in result.out.splitlines() if "not count" in line]
    assert len(aside) == 9
    assert aside[-1] == "  5 more do not count; --json gives the reason for each"


def test_a_camera_on_new_photographs_has_no_in_sample_error(run, camera, poses):
    others = corner_set(poses, noise=0.02)
    renamed = [type(v)(f"new-{v.name}", v.ids, v.uv) for v in others.views]
    write_corner_table("new.vnl", others.with_views(renamed))
    result = run("evaluate", camera, "--corners", "new.vnl")
    row = next(line for line in result.out.splitlines() if "pinholify" in line)
    assert row.split()[-2:] == ["–", "–"]


# --- map -----------------------------------------------------------------------------------------------------


def points(text):
    rows = text.strip().splitlines()
    return rows[0], np.array([[float(x) for x in row.split(",")] for row in rows[1:]])


PIXELS = "u,v,note\n320,240,middle\n100.5,80.25,\nnan,nan,nothing\n5000,5000,far\n320,240,again\n"


@pytest.mark.parametrize(
    ("target", "header"),
    [("rays", "x,y,z,std_px"), ("virtual", "x,y,std_x,std_y")],
)
def test_map_keeps_rows(run, camera, monkeypatch, target, header):
    monkeypatch.setattr(sys, "stdin", io.StringIO(PIXELS))
    result = run("map", camera, "-", "--to", target)
    assert result.status == 0
    first, rows = points(result.out)
    assert first == header
    assert rows.shape == (5, 4)
    assert np.isnan(rows[2, :2]).all()
    assert np.array_equal(rows[0], rows[4])
    assert np.isfinite(rows[:2]).all()
    monkeypatch.setattr(sys, "stdin", io.StringIO("u,v\n100.5,80.25\n"))
    alone = points(run("map", camera, "-", "--to", target).out)[1]
    assert rows[1] == pytest.approx(alone[0], abs=1e-9)
    assert "of 5 points have no result (nan)" in result.err


def test_map_there_and_back(run, camera):
    Path("uv.csv").write_text("u,v\n320,240\n100.5,80.25\n600,470\n")
    for target in ("virtual", "rays"):
        run("map", camera, "uv.csv", "--to", target, "-o", f"{target}.csv")
        result = run("map", camera, f"{target}.csv", "--to", "image")
        header, rows = points(result.out)
        assert header == "u,v,std_u,std_v"
        assert rows[:, :2] == pytest.approx(np.array([[320, 240], [100.5, 80.25], [600, 470]]), abs=1e-4)
        assert (rows[:, 2:] > 0).all()


def test_map_rays_are_the_lens(run, camera, poses):
    """Rays of the reference's frame, turned by the true pose of its board, are those of the simulated lens."""
    uv = np.array([[320.0, 240.0], [200.0, 160.0], [450.0, 300.0]])
    Path("uv.csv").write_text("u,v\n" + "".join(f"{u},{v}\n" for u, v in uv))
    _, rows = points(run("map", camera, "uv.csv", "--to", "rays").out)
    true = LENS.unproject(uv).directions @ poses[0].rotation
    assert rows[:, :3] == pytest.approx(true, abs=1e-3)
    assert np.linalg.norm(rows[:, :3], axis=1) == pytest.approx(1.0)


def test_map_a_ray_that_no_pixel_sees(run, camera, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("x,y,z\n0,0,1\n0,0,-1\n"))
    result = run("map", camera, "-", "--to", "image")
    assert np.isnan(points(result.out)[1][1]).all()
    assert result.err == "1 of 2 points have no result (nan)\n"


def test_map_of_no_points(run, camera, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("u,v\n"))
    result = run("map", camera, "-", "--to", "rays")
    assert (result.status, result.out, result.err) == (0, "x,y,z,std_px\n", "")


# --- undistort -----------------------------------------------------------------------------------------------


def test_undistort_makes_boards_straight(run, camera, photographs):
    path = photographs / "small-00.png"
    result = run("undistort", camera, path, "-o", "out", "--view", "board", "--max-std", "2")
    assert result.status == 0
    assert result.out == "wrote 1 image into out\n"
    run("detect", path, "out/small-00.png", "--board", "9x6", "-o", "c.vnl")
    bent, straight = (bow(v) for v in read_corner_table("c.vnl", board=BOARD, image_size=SIZE).views)
    assert bent > 2.0
    assert straight < 0.25


def bow(view):
    """Largest distance in px of a corner from the line through its row or column."""
    lines = board_lines(lattice(BOARD)[view.ids], view.uv)
    return max(np.linalg.svd(line - line.mean(axis=0))[1][1] for line in lines)


@pytest.mark.parametrize("method", ["remap", "splat"])
def test_undistort_keeps_colour_depth_and_ending(run, camera, photographs, method):
    grey = read_image(photographs / "small-01.png")
    write_image("colour.jpg", np.dstack([grey] * 3))
    write_image("deep.png", grey.astype(np.uint16) * 200)
    words = ["--size", "320x200", "--method", method, "--json"]
    result = run("undistort", camera, "colour.jpg", "deep.png", "-o", "out", *words)
    said = json.loads(result.out)
    view = said.pop("view")
    assert said == {
        "format_version": 1,
        "written": [str(Path("out/colour.jpg")), str(Path("out/deep.png"))],
        "failed": {},
    }
    assert (view["name"], view["surface"], view["size"]) == ("camera", "plane", [320, 200])
    assert np.linalg.det(view["rotation"]) == pytest.approx(1.0)
    assert read_image("out/colour.jpg").shape == (200, 320, 3)
    deep = read_image("out/deep.png")
    assert (deep.shape, deep.dtype) == ((200, 320), np.uint16)
    assert deep.max() > 20_000


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_undistort_keeps_alpha_and_is_clear_where_others_are_black(run, camera, photographs, dtype):
    grey = read_image(photographs / "small-01.png").astype(dtype)
    full = np.iinfo(dtype).max
    write_image("clear.png", np.dstack([grey, grey, grey, np.full_like(grey, full)]))
    write_image("opaque.png", np.full((*grey.shape, 3), full, dtype))
    assert run("undistort", camera, "clear.png", "opaque.png", "-o", "out", "--size", "320x200").status == 0
    clear = cv2.imread("out/clear.png", cv2.IMREAD_UNCHANGED)
    assert (clear.shape, clear.dtype) == ((200, 320, 4), dtype)
    np.testing.assert_array_equal(clear[:, :, 3], read_image("out/opaque.png")[:, :, 0])
    assert {0, full} == set(np.unique(clear[:, :, 3]))


@pytest.mark.parametrize("name", ["out.jpg", "out.PNG", "out.mp4", "file:///tmp/no/such/out.jpg"])
def test_undistort_makes_no_folder_that_is_called_like_a_file(run, camera, photographs, name):
    result = run("undistort", camera, photographs / "small-01.png", "-o", name)
    assert result.status == 1
    assert result.err == (
        f"pinholify: '{name}' looks like a file name, but pictures keep their own names: "
        "give a folder to write them into\n"
    )
    assert not Path(name).exists()


def test_undistort_writes_into_a_folder_that_is_called_like_a_file(run, camera, photographs):
    Path("out.jpg").mkdir()
    assert run("undistort", camera, photographs / "small-01.png", "-o", "out.jpg", "--size", "320x200").status == 0
    assert Path("out.jpg/small-01.png").exists()


def test_undistort_reports_failures_and_does_the_rest(run, camera, photographs):
    Path("text.jpg").write_text("no image\n")
    Path("empty.jpg").write_text("")
    result = run("undistort", camera, "text.jpg", "empty.jpg", photographs / "small-01.png", "-o", "out", "--json")
    assert result.status == 1
    data = json.loads(result.out)
    assert data["written"] == [str(Path("out/small-01.png"))]
    assert set(data["failed"]) == {"text.jpg", "empty.jpg"}
    lines = result.err.splitlines()
    assert len(lines) == 3
    assert lines[-1].startswith("pinholify: 2 of 3 images could not be straightened: ")


def test_undistort_shows_more_with_a_larger_limit(run, camera, photographs):
    path = photographs / "small-00.png"
    shown = []
    for limit in ("0.1", "10"):
        run("undistort", camera, path, "-o", "out", "--max-std", limit, "--force")
        shown.append(np.count_nonzero(read_image("out/small-00.png")))
    assert shown[0] < shown[1]


def test_undistort_goes_on_where_it_was_stopped(run, camera, photographs):
    assert run("undistort", camera, photographs, "-o", "out", "--workers", "2").status == 0
    made = {path: path.stat().st_mtime_ns for path in Path("out").iterdir()}
    gone = Path("out/small-03.png")
    gone.unlink()
    again = run("undistort", camera, photographs, "-o", "out")
    assert (again.status, again.out) == (1, "")
    assert "use --resume to do only the rest" in again.err
    result = run("undistort", camera, photographs, "-o", "out", "--resume")
    assert (result.status, result.out) == (0, "wrote 1 image into out; 6 were already there\n")
    assert {path: path.stat().st_mtime_ns for path in made if path != gone} == {
        path: time for path, time in made.items() if path != gone
    }
    data = json.loads(run("undistort", camera, photographs, "-o", "out", "--resume", "--json").out)
    assert (data["written"], len(data["finished_before"]), data["failed"]) == ([], 7, {})
    other = run("undistort", camera, photographs, "-o", "out", "--resume", "--view", "board")
    assert "does not come from this photograph, camera and view" in other.err
    assert run("undistort", camera, photographs, "-o", "out", "--view", "board", "--resume", "--force").status == 0


def test_undistort_from_and_to_any_storage(run, camera, photographs):
    fsspec = pytest.importorskip("fsspec", reason="needs the extra 'cluster'")
    memory = fsspec.filesystem("memory")
    memory.put(str(photographs), "/photos", recursive=True)
    result = run("undistort", camera, "memory://photos", "-o", "memory://straight")
    assert (result.status, result.out) == (0, "wrote 7 images into memory://straight\n")
    assert run("undistort", camera, photographs, "-o", "out").status == 0
    assert memory.cat("/straight/small-02.png") == Path("out/small-02.png").read_bytes()
    memory.store.clear()


# --- board and simulate --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "start"), [("b.pdf", b"%PDF"), ("b.svg", b"<svg"), ("b.png", b"\x89PNG")])
def test_board(run, name, start):
    result = run("board", "9x6", "--square", "2.5cm", "-o", name)
    assert result.status == 0
    assert result.out == f"wrote {name}\n"
    assert Path(name).read_bytes().lstrip().startswith(start)


def test_printed_board_is_found(run):
    run("board", "9x6", "--square", "20mm", "--page", "A4", "-o", "b.png")
    picture = read_image("b.png")
    scale = 900 / max(picture.shape)
    write_image("small.png", cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    result = run("detect", "small.png", "--board", "9x6", "--json")
    assert json.loads(result.out)["images"][0]["corners"] == 54


def test_simulate(run, monkeypatch):
    monkeypatch.setattr("pinholify.simulation.datasets.DATASETS", {"small": SMALL})
    result = run("simulate", "small", "-o", "data", "--views", "2")
    assert result.status == 0
    assert sorted(p.name for p in Path("data/small").iterdir()) == [
        "corners.vnl", "small-00.png", "small-01.png", "truth.npz",
    ]  # fmt: skip
    corners = read_corner_table("data/small/corners.vnl", board=BOARD, image_size=SIZE)
    assert [len(v) for v in corners.views] == [54, 54]
    with np.load("data/small/truth.npz") as archive:
        assert archive["f_uc_vc"] == pytest.approx(truth())
        assert archive["directions"].shape == (len(archive["pixels"]), 3)


def test_photographs_whose_corners_were_refined_are_no_unseen_ones(run, photographs):
    """Their corners as found without the camera differ from those that it was made from."""
    words = ["--board", "9x6", "--no-opencv", "--no-heldout", "--refine-corners", "-o", "camera.npz"]
    assert run("calibrate", photographs, *words).status == 0
    calibration = read_camera("camera.npz")
    found = detect_files(sorted(photographs.glob("*.png")), calibration.corner_set.board)
    assert not any(np.array_equal(a.uv, b.uv) for a, b in zip(found.views, calibration.corner_set.views, strict=True))
    evaluation = evaluate(calibration, found, compare_opencv=False)
    assert evaluation.heldout_px is None  # it has seen them all
    assert evaluation.in_sample
