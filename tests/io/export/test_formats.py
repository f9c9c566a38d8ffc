"""Every format read by the program it is for: the same projection as ours, to 1e-3 px, and the same maps."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.io import loadmat

from mrcal_oracle import mrcal
from pinholify.camera import Domain
from pinholify.errors import CalibrationError, InputError, OutputError
from pinholify.geometry import ConvexRegion
from pinholify.io.export import FORMATS, format_named, mrcal_splined
from pinholify.io.export.base import PinholeExport, export_view, pinhole_export
from pinholify.io.export.mrcal_splined import COLUMNS, splined_model
from pinholify.io.importing.adoption import adopt
from pinholify.io.importing.base import ForeignCamera
from pinholify.io.importing.projections import splined_stereographic
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.straightener import Straightener
from pinholify.rectification.valid_region import valid_pixels
from pinholify.simulation.lenses import LENSES
from tilted import IMAGE_SIZE, tilted_calibration

SIZE = (480, 300)
TOLERANCE = 1e-3  # px
SPLINE_TOLERANCE = 0.01  # px, of the spline that repeats the camera in mrcal's model
MAP_TOLERANCE = 0.01  # px, of the expansion of the maps


@pytest.fixture(scope="module")
def tilted_camera():
    return tilted_calibration().camera


@pytest.fixture(scope="module")
def export(tilted_camera) -> PinholeExport:
    return pinhole_export(tilted_camera, ViewOptions(size=SIZE))


@pytest.fixture(scope="module")
def written(export, tmp_path_factory) -> dict[str, Path]:
    """The path each format was given; the formats of FileStorage and YAML under both endings."""
    folder = tmp_path_factory.mktemp("export")
    paths = {}
    for name in FORMATS:
        form = format_named(name)
        for suffix in form.suffixes:
            paths[f"{name}{suffix}"] = folder / f"{name}{suffix}"
            form.write(export, paths[f"{name}{suffix}"])
    return paths


@pytest.fixture(scope="module")
def points(export) -> np.ndarray:
    """Points (200, 3) of the reference board's frame that the view sees, at several depths."""
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0, np.array(SIZE) - 1, (200, 2))
    return export.view.directions(pixels) * rng.uniform(2.0, 20.0, (200, 1))


@pytest.fixture(scope="module")
def in_view(export, points) -> np.ndarray:
    """The same points in the frame of the view, where the exported models live."""
    return points @ export.view.rotation.T


def ffmpeg() -> str:
    """The program, or a skip."""
    found = os.environ.get("FFMPEG") or shutil.which("ffmpeg")
    if found is None:
        pytest.skip("ffmpeg is not installed")
    return found


def opencv_projection(in_view, matrix, distortion):
    return cv2.projectPoints(in_view, np.zeros(3), np.zeros(3), np.array(matrix), np.array(distortion))[0][:, 0]


def pinhole(in_view, fx, fy, cx, cy):
    return in_view[:, :2] / in_view[:, 2:] * [fx, fy] + [cx, cy]


def storage(path):
    opened = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert opened.isOpened()
    return opened


def yaml_of(path):
    yaml = pytest.importorskip("yaml")
    return yaml.safe_load(path.read_text(encoding="utf-8"))


# --- K ---


@pytest.mark.parametrize("suffix", format_named("opencv").suffixes)
def test_opencv(written, export, points, in_view, suffix):
    read = storage(written[f"opencv{suffix}"])
    matrix, distortion = read.getNode("camera_matrix").mat(), read.getNode("distortion_coefficients").mat()
    assert np.abs(opencv_projection(in_view, matrix, distortion) - export.view.project(points)).max() < TOLERANCE
    assert (read.getNode("image_width").real(), read.getNode("image_height").real()) == SIZE
    np.testing.assert_allclose(read.getNode("rotation").mat(), export.view.rotation, atol=1e-12)
    assert read.getNode("view").string() == "camera"
    assert "--view camera --size 480x300" in read.getNode("statement").string()


@pytest.mark.parametrize("suffix", format_named("ros").suffixes)
def test_ros(written, export, points, in_view, suffix):
    data = yaml_of(written[f"ros{suffix}"])
    arrays = {
        name: np.array(value["data"]).reshape(value["rows"], value["cols"])
        for name, value in data.items()
        if isinstance(value, dict)
    }
    projected = opencv_projection(in_view, arrays["camera_matrix"], arrays["distortion_coefficients"])
    assert np.abs(projected - export.view.project(points)).max() < TOLERANCE
    q = np.column_stack([in_view, np.ones(len(in_view))]) @ arrays["projection_matrix"].T
    assert np.abs(q[:, :2] / q[:, 2:] - export.view.project(points)).max() < TOLERANCE
    np.testing.assert_array_equal(arrays["rectification_matrix"], np.eye(3))
    assert (data["image_width"], data["image_height"], data["distortion_model"]) == (*SIZE, "plumb_bob")


@pytest.mark.parametrize(("name", "model"), [("colmap", "PINHOLE"), ("colmap-simple", "SIMPLE_PINHOLE")])
def test_colmap(written, export, points, in_view, tmp_path, name, model):
    pycolmap = pytest.importorskip("pycolmap")
    (tmp_path / "cameras.txt").write_bytes(written[f"{name}.txt"].read_bytes())
    (tmp_path / "images.txt").touch()
    (tmp_path / "points3D.txt").touch()
    reconstruction = pycolmap.Reconstruction()
    reconstruction.read_text(tmp_path)
    camera = reconstruction.cameras[1]
    assert (camera.model_name, camera.width, camera.height) == (model, *SIZE)
    # COLMAP's origin is the corner of the top-left pixel.
    assert np.abs(camera.img_from_cam(in_view) - 0.5 - export.view.project(points)).max() < TOLERANCE


@pytest.mark.parametrize("suffix", format_named("kalibr").suffixes)
def test_kalibr(written, export, points, in_view, suffix):
    camera = yaml_of(written[f"kalibr{suffix}"])["cam0"]
    assert (camera["camera_model"], camera["distortion_model"]) == ("pinhole", "radtan")
    assert camera["distortion_coeffs"] == [0.0] * 4
    assert camera["resolution"] == list(SIZE)
    assert np.abs(pinhole(in_view, *camera["intrinsics"]) - export.view.project(points)).max() < TOLERANCE


def test_mrcal_text(written, export, points, in_view):
    model = ast.literal_eval(written["mrcal.cameramodel"].read_text(encoding="utf-8"))
    assert model["lensmodel"] == "LENSMODEL_PINHOLE"
    assert model["imagersize"] == list(SIZE)
    assert np.abs(pinhole(in_view, *model["intrinsics"]) - export.view.project(points)).max() < TOLERANCE


def test_mrcal(written, export, points):
    """mrcal takes points of the board's frame all the way to pixels of the view."""
    projected, _ = mrcal(written["mrcal.cameramodel"], points)
    assert np.abs(projected - export.view.project(points)).max() < TOLERANCE


def test_mrcal_splined(written, export):
    """mrcal's own projection and unprojection of the camera itself, over all that may be believed of the image."""
    camera = export.camera
    uv = np.random.default_rng(2).uniform(0, np.array(IMAGE_SIZE) - 1, (2000, 2))
    uv = uv[camera.inside(uv)]
    projected, rays = mrcal(written["mrcal-splined.cameramodel"], camera.to_rays(uv).directions, uv)
    assert np.abs(projected - uv).max() < SPLINE_TOLERANCE
    assert np.abs(camera.project(rays) - uv).max() < SPLINE_TOLERANCE


@pytest.mark.parametrize("name", ["unity-barrel", "rational-prism-tilt", "fisheye", "windscreen"])
def test_mrcal_splined_over_the_whole_image(name, tmp_path):
    """Lenses of every kind, their images to the very corners, against the lens itself."""
    lens = LENSES[name]
    centre = np.array(lens.size) / 2.0
    foreign = ForeignCamera("file", "simulation", name, lens.project, np.full(2, 500.0), centre, lens.size)
    said = export_view(adopt(foreign).calibration.camera, "mrcal-splined", tmp_path / "a.cameramodel")
    assert "where it can be trusted" in said[0]
    assert not any("cannot be trusted" in sentence for sentence in said)
    uv = np.random.default_rng(3).uniform(0, np.array(lens.size) - 1, (500, 2))
    _, rays = mrcal(tmp_path / "a.cameramodel", [[0.0, 0.0, 1.0]], uv)
    assert np.abs(lens.project(rays) - uv).max() < SPLINE_TOLERANCE


@pytest.mark.parametrize("columns", [COLUMNS[0], COLUMNS[2]])
def test_the_largest_error_that_a_spline_tells_holds_at_every_pixel(export, columns, monkeypatch):
    """On a grid finer than its own, out to the border of what may be believed: a hull, and a limit of std."""
    monkeypatch.setattr(mrcal_splined, "COLUMNS", (columns,))
    camera, size = export.camera, np.array(IMAGE_SIZE)
    uv = np.stack(np.meshgrid(*(np.linspace(-0.5, n - 0.51, 2 * n // 3) for n in size)), axis=-1).reshape(-1, 2)
    for chosen in (export, replace(export, camera=replace(camera, domain=replace(camera.domain, max_std=1.0)))):
        model = splined_model(chosen)
        seen = uv[valid_pixels(chosen.camera, uv, chosen.options.max_std)]
        directions = camera.to_rays(seen).directions @ export.view.rotation.T
        errors = np.linalg.norm(splined_stereographic(model.core, model.surface)(directions) - seen, axis=1)
        assert errors.max() <= 1.0001 * model.largest_px + 1e-7  # px, where the map itself is rounded
        assert errors.max() > 0.5 * model.largest_px


def test_mrcal_splined_says_what_it_is(written, export):
    text = written["mrcal-splined.cameramodel"].read_text(encoding="ascii")
    model = ast.literal_eval(text)
    assert model["imagersize"] == list(IMAGE_SIZE)
    region = np.array(model["valid_intrinsics_region"])
    np.testing.assert_array_equal(region[0], region[-1])
    assert export.camera.domain.hull.contains(region, margin=1.0).all()
    assert ConvexRegion(region[:-1]).area > 0.95 * export.camera.domain.hull.area
    assert "% of the image cannot be trusted" in text
    assert "do not straighten them first" in text


def test_a_size_is_refused_for_the_camera_itself(tilted_camera, tmp_path):
    with pytest.raises(InputError, match="omit size, fov and keep"):
        export_view(tilted_camera, "mrcal-splined", tmp_path / "a.cameramodel", ViewOptions(size=SIZE))
    assert not list(tmp_path.iterdir())


def test_too_little_to_fit_a_spline_to_is_refused(export):
    few = replace(export.camera, domain=Domain(ConvexRegion(np.array([[300.0, 200], [304, 200], [304, 204]]))))
    with pytest.raises(CalibrationError, match="too little of the image can be trusted"):
        splined_model(replace(export, camera=few))


def test_nerfstudio(written, export, points, in_view):
    data = json.loads(written["nerfstudio.json"].read_text(encoding="utf-8"))
    assert (data["camera_model"], data["w"], data["h"], data["frames"]) == ("OPENCV", *SIZE, [])
    assert [data[name] for name in ("k1", "k2", "k3", "k4", "p1", "p2")] == [0.0] * 6
    # A pixel's centre lies at half-integers there.
    projected = pinhole(in_view, *(data[name] for name in ("fl_x", "fl_y", "cx", "cy"))) - 0.5
    assert np.abs(projected - export.view.project(points)).max() < TOLERANCE


def test_matlab(written, export, points, in_view):
    data = loadmat(written["matlab.mat"])
    # MATLAB counts from one.
    q = in_view @ data["K"].T
    assert np.abs(q[:, :2] / q[:, 2:] - 1.0 - export.view.project(points)).max() < TOLERANCE
    parts = np.concatenate([data["FocalLength"][0], data["PrincipalPoint"][0]])
    np.testing.assert_array_equal(parts, data["K"][[0, 1, 0, 1], [0, 1, 2, 2]])
    assert tuple(data["ImageSize"][0]) == SIZE[::-1]
    assert data["view"] == ["camera"]


# --- maps ---


def assert_maps_are_the_cameras(export, uv):
    """``uv`` (h, w, 2) shows each valid pixel of the view where the camera sees the same ray."""
    y, x = np.nonzero(export.rectification.valid)
    chosen = np.random.default_rng(1).choice(len(x), 500, replace=False)
    x, y = x[chosen], y[chosen]
    seen = export.camera.project(export.view.directions(np.column_stack([x, y]).astype(float)))
    assert np.abs(uv[y, x] - seen).max() < MAP_TOLERANCE
    # And forth: the rays of those pixels of the original, projected by the view, are the view's pixels.
    back = export.view.project(export.camera.to_rays(seen).directions)
    assert np.abs(back - np.column_stack([x, y])).max() < TOLERANCE


@pytest.fixture(scope="module")
def picture():
    """Colours that tell where in the original they come from."""
    y, x = np.mgrid[0 : IMAGE_SIZE[1], 0 : IMAGE_SIZE[0]]
    return np.stack([x % 256, y % 256, x // 256 * 30 + y // 256], axis=-1).astype(np.uint8)


@pytest.mark.parametrize("suffix", format_named("opencv").suffixes)
def test_opencv_maps(written, export, picture, suffix):
    read = storage(format_named("opencv").files(written[f"opencv{suffix}"])[1])
    map_x, map_y = read.getNode("map_x").mat(), read.getNode("map_y").mat()
    assert map_x.dtype == map_y.dtype == np.float32
    assert_maps_are_the_cameras(export, np.stack([map_x, map_y], axis=-1))
    remapped = cv2.remap(picture, map_x, map_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    straight = Straightener(export.camera, ViewOptions(size=SIZE))(picture)
    valid = export.rectification.valid
    assert not remapped[~valid].any()
    inner = cv2.erode(valid.astype(np.uint8), np.ones((5, 5)), borderValue=0).astype(bool)
    np.testing.assert_array_equal(remapped[inner], straight[inner])


def test_npy_maps(written, export):
    uv = np.load(written["npy.npy"], allow_pickle=False)
    assert (uv.dtype, uv.shape) == (np.float32, (*SIZE[::-1], 2))
    np.testing.assert_array_equal(np.isfinite(uv).all(axis=2), export.rectification.valid)
    assert_maps_are_the_cameras(export, uv)


def test_matlab_maps(written, export):
    data = loadmat(written["matlab.mat"])
    np.testing.assert_array_equal(data["valid"].astype(bool), export.rectification.valid)
    np.testing.assert_array_equal(np.isfinite(data["map_x"]), export.rectification.valid)
    assert_maps_are_the_cameras(export, np.stack([data["map_x"], data["map_y"]], axis=-1) - 1.0)


def test_ffmpeg_maps_are_the_nearest_pixels(written, export):
    paths = format_named("ffmpeg").files(written["ffmpeg.pgm"])
    whole = np.stack([cv2.imread(str(p), cv2.IMREAD_UNCHANGED) for p in paths], axis=-1)
    assert whole.dtype == np.uint16
    known = (whole != 65535).all(axis=2)
    assert (known == export.rectification.valid).mean() > 0.999  # less a pixel at the image's border
    assert np.abs(whole[known] - export.rectification.uv[known]).max() <= 0.5
    assert (whole[~known] == 65535).all()


def test_ffmpeg(written, picture, tmp_path):
    program, paths = ffmpeg(), format_named("ffmpeg").files(written["ffmpeg.pgm"])
    cv2.imwrite(str(tmp_path / "in.png"), picture)
    inputs = [word for path in (tmp_path / "in.png", *paths) for word in ("-i", str(path))]
    command = [program, "-v", "error", *inputs, "-lavfi", "remap", "-pix_fmt", "bgr24", str(tmp_path / "out.png")]
    subprocess.run(command, check=True, capture_output=True)
    x, y = (cv2.imread(str(p), cv2.IMREAD_UNCHANGED) for p in paths)
    known = x != 65535
    out = cv2.imread(str(tmp_path / "out.png"))
    np.testing.assert_array_equal(out[known], picture[y[known], x[known]])
    assert not out[~known].any()


# --- all of them ---


def test_every_format_writes_its_files_and_nothing_else(export, tmp_path):
    for name in FORMATS:
        form = format_named(name)
        path = tmp_path / name / f"out{form.suffixes[0]}"
        path.parent.mkdir()
        form.write(export, path)
        assert sorted(path.parent.iterdir()) == sorted(form.files(path))


TEXTS = ("colmap.txt", "colmap-simple.txt", "kalibr.yaml", "mrcal.cameramodel", "nerfstudio.json", "ros.yaml")


@pytest.mark.parametrize("name", TEXTS)
def test_texts_state_their_view(written, name):
    text = written[name].read_text(encoding="ascii")
    assert "pinholify undistort CAMERA IMAGES --view camera --size 480x300" in text


def test_a_limit_of_the_std_is_stated_and_kept(tilted_camera):
    export = pinhole_export(tilted_camera, ViewOptions("board", size=(96, 72), max_std=0.5))
    assert "--view board --size 96x72 --max-std 0.5 -o" in " ".join(export.statement)
    np.testing.assert_array_equal(export.view.rotation, np.eye(3))
    y, x = np.nonzero(export.rectification.valid)
    seen = export.rectification.uv[y, x].astype(float)
    assert export.camera.to_rays(seen).std_px.max() < 0.6


def test_losses_are_told(tilted_camera, export, tmp_path):
    lost = export_view(tilted_camera, "ros", tmp_path / "a.yaml", ViewOptions(size=SIZE))
    share = 1.0 - export.rectification.valid.mean()
    assert lost[0] == f"{100 * share:.1f} % of the view shows nothing that can be trusted and is black in its images"
    assert "cannot hold the maps" in lost[-1]


def test_a_view_too_narrow_for_all_says_so(export):
    """Where the valid part reaches beyond 65° from the view's axis, or is cut by it."""
    view = export.view
    left_half = type(view)(view.matrix, view.rotation, (SIZE[0] // 2, SIZE[1]))
    cut = type(export.rectification)(left_half, export.rectification.uv[:, : SIZE[0] // 2], export.rectification.valid)
    sentences = replace(export, rectification=cut).losses()
    assert len(export.losses()) == 1
    assert sentences[-1].endswith("of the trusted part of the original image lies outside the view")
    assert 35.0 < float(sentences[-1].split("%")[0]) < 65.0


def test_unknown_formats_and_endings_are_refused(tilted_camera, tmp_path):
    with pytest.raises(InputError, match="unknown export format 'agisoft': choose one of colmap, "):
        export_view(tilted_camera, "agisoft", tmp_path / "a.xml")
    with pytest.raises(OutputError, match=r"ends in '.txt', but files of this format end in .yaml or .yml"):
        export_view(tilted_camera, "ros", tmp_path / "a.txt")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_refused(tilted_camera, export, tmp_path):
    for name in FORMATS:
        form = format_named(name)
        with pytest.raises(OutputError, match="its folder does not exist"):
            form.write(export, tmp_path / "no" / f"a{form.suffixes[0]}")
