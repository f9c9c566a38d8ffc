"""Other programs' cameras as ours: the same rays, where they see anything, and what is not a camera refused."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from foreign_files import CORE, DISTORTION, FILES, KALIBR, MRCAL, OPENCV, ROS, SIZE
from hypothesis import given, settings
from hypothesis import strategies as st

from pinholify.board import Checkerboard
from pinholify.errors import CalibrationError, CameraFileError
from pinholify.io.camera_file import read_camera, write_camera
from pinholify.io.export.base import export_view, pinhole_export
from pinholify.io.importing import read_foreign
from pinholify.io.importing.adoption import adopt
from pinholify.io.importing.base import ForeignCamera
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.straightener import Straightener
from pinholify.refinement.comparison import compare
from pinholify.simulation.lenses import LENSES
from tilted import tilted_calibration

TOLERANCE = 0.005  # px between their camera and ours
MATRIX = np.array([[CORE[0], 0, CORE[2]], [0, CORE[1], CORE[3]], [0, 0, 1]])
PIXELS = np.random.default_rng(0).uniform(-0.5, np.array(SIZE) - 0.5, (500, 2))


@pytest.fixture
def imported(tmp_path):
    """Reads text as a file of that name: the camera adopted."""

    def read(text, name="file", **options):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return adopt(read_foreign(path, **options))

    return read


@pytest.mark.parametrize("name", FILES)
def test_every_program(imported, name):
    adopted = imported(FILES[name], name, camera="cam0" if name == "kalibr.yaml" else None)
    camera = adopted.calibration.camera
    distortion = np.array(DISTORTION[:4] if name == "kalibr.yaml" else DISTORTION)
    rays = camera.to_rays(PIXELS).directions
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), MATRIX, distortion)[0][:, 0]
    assert np.abs(seen - PIXELS).max() < TOLERANCE
    assert np.abs(camera.project(rays) - PIXELS).max() < 1e-6
    assert camera.inside(PIXELS).all()
    assert adopted.covered == pytest.approx(1.0)
    assert adopted.largest_px < 1e-3
    # The virtual plane is theirs: an ideal pinhole image with their centre, in px.
    ideal = (camera.virtual_points(PIXELS) - CORE[2:]) / camera.intrinsics.f
    solid = np.column_stack([ideal, np.ones(len(ideal))])
    seen = cv2.projectPoints(solid, np.zeros(3), np.zeros(3), MATRIX, distortion)[0][:, 0]
    assert np.abs(seen - PIXELS).max() < TOLERANCE


def test_the_std_is_that_of_the_fit(imported):
    adopted = imported(OPENCV)
    camera = adopted.calibration.camera
    expected = np.full(len(PIXELS), adopted.rms_px / np.sqrt(2.0))
    np.testing.assert_allclose(camera.to_rays(PIXELS).std_px, expected, rtol=1e-6)
    np.testing.assert_allclose(camera.shape_std(PIXELS), expected, rtol=1e-6)
    assert np.isnan(adopted.calibration.intrinsics_std).all()
    assert adopted.calibration.details["fit_rms_px"] == adopted.rms_px


def test_a_camera_file_keeps_it(imported, tmp_path):
    calibration = imported(ROS).calibration
    write_camera(tmp_path / "camera.npz", calibration)
    read = read_camera(tmp_path / "camera.npz")
    np.testing.assert_array_equal(
        read.camera.to_rays(PIXELS).directions, calibration.camera.to_rays(PIXELS).directions
    )
    assert read.details == calibration.details
    assert not read.corner_set.views
    with np.load(tmp_path / "camera.npz") as archive:
        assert json.loads(archive["header"].tobytes())["units"]["virtual"] == read.unit == "px"


def test_it_straightens_as_opencv_does(imported):
    """Our map of a view of theirs is OpenCV's own for the same matrix."""
    camera = imported(OPENCV).calibration.camera
    straightener = Straightener(camera, ViewOptions("board", size=(320, 240)))
    export = pinhole_export(camera, ViewOptions("board", size=(320, 240)))
    theirs = cv2.initUndistortRectifyMap(
        MATRIX, np.array(DISTORTION), np.eye(3), export.view.matrix, (320, 240), cv2.CV_32FC2
    )[0]
    valid = export.rectification.valid
    assert valid.mean() > 0.7
    assert np.abs(export.rectification.uv - theirs)[valid].max() < 0.02
    assert straightener(np.full((480, 640), 7, np.uint8))[valid].min() == 7


@pytest.mark.parametrize("name", ["opencv", "ros", "kalibr", "mrcal"])
def test_what_we_export_comes_back(name, tmp_path):
    """A view's own camera is the ideal pinhole that was exported."""
    suffix = ".cameramodel" if name == "mrcal" else ".yaml"
    calibration = tilted_calibration()
    export_view(calibration.camera, name, tmp_path / f"a{suffix}", ViewOptions(size=(320, 240)))
    view = pinhole_export(calibration.camera, ViewOptions(size=(320, 240))).view
    camera = adopt(read_foreign(tmp_path / f"a{suffix}")).calibration.camera
    uv = PIXELS / 2.0
    rays = camera.to_rays(uv).directions @ view.rotation
    assert np.abs(view.project(rays) - uv).max() < TOLERANCE


def test_a_camera_that_went_to_mrcal_and_back_is_the_same(tmp_path):
    camera = tilted_calibration().camera
    export_view(camera, "mrcal-splined", tmp_path / "a.cameramodel")
    back = adopt(read_foreign(tmp_path / "a.cameramodel")).calibration.camera
    difference = compare(camera, back)
    assert difference.covered.sum() > 100
    assert np.abs(difference.difference[difference.covered]).max() < TOLERANCE


@pytest.mark.parametrize("name", ["pinhole", "unity-barrel", "brown-conrady", "rational-prism-tilt", "fisheye"])
def test_any_central_lens_is_repeated(name):
    lens = LENSES[name]
    adopted = adopt(foreign(lens.project, lens.size))
    camera = adopted.calibration.camera
    rng = np.random.default_rng(1)
    pixels = rng.uniform(0, np.array(lens.size) - 1, (300, 2))
    assert np.abs(lens.project(camera.to_rays(pixels).directions) - pixels).max() < TOLERANCE
    assert adopted.covered == pytest.approx(1.0)


def foreign(project, size=SIZE, focal=(300.0, 300.0)):
    centre = (np.array(size) - 1.0) / 2.0
    return ForeignCamera("file", "test", "lens", project, np.array(focal), centre, size)


def test_an_image_in_a_mirror_is_mirrored():
    def project(xyz):
        return xyz[:, :2] / np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan) * [-300.0, 300.0] + [319.5, 239.5]

    camera = adopt(foreign(project)).calibration.camera
    assert camera.mirrored
    assert np.abs(project(camera.to_rays(PIXELS).directions) - PIXELS).max() < TOLERANCE


def test_a_lens_that_folds_is_believed_where_it_does_not():
    """r = θ − θ³/3 turns back at θ = 1: the image beyond its largest radius, 2/3 of f, shows nothing."""

    def project(xyz):
        theta = np.arctan2(np.hypot(*xyz[:, :2].T), xyz[:, 2])
        rho = np.maximum(np.hypot(*xyz[:, :2].T), 1e-300)
        return xyz[:, :2] / rho[:, None] * (300.0 * (theta - theta**3 / 3.0))[:, None] + [319.5, 239.5]

    adopted = adopt(foreign(project))
    camera = adopted.calibration.camera
    radius = np.linalg.norm(PIXELS - [319.5, 239.5], axis=1)
    inside = camera.inside(PIXELS)
    assert not inside[radius > 200.0].any()
    assert inside[radius < 180.0].all()
    assert 0.3 < adopted.covered < 0.41  # π · 200² ÷ (640 · 480) = 0.409
    rays = camera.to_rays(PIXELS[inside]).directions
    assert np.abs(project(rays) - PIXELS[inside]).max() < 0.05  # near the fold, rays change without bound
    assert np.arccos(rays[:, 2]).max() < 1.0


def test_a_spline_that_flies_off_and_comes_back_is_followed_only_as_far_as_it_goes_on(imported):
    """Beyond its knots a rough spline is a cubic that returns to the image, upright: none of that is the lens."""
    model = "SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=11_fov_x_deg=120"
    bent = np.random.default_rng(0).normal(0, 0.02, 16 * 11 * 2).tolist()
    numbers = ", ".join(map(repr, [500.0, 510.0, 320.0, 240.0, *bent]))
    adopted = imported(MRCAL.replace("OPENCV5", model).replace(", ".join(map(repr, CORE + DISTORTION)), numbers))
    assert adopted.covered == pytest.approx(1.0)
    assert adopted.largest_px < TOLERANCE
    # Near the axis a stereographic camera of f = 500 px, bent by some 10 px.
    rays = adopted.calibration.camera.to_rays(PIXELS).directions
    assert rays[:, 2].min() > np.cos(np.deg2rad(50.0))


def test_a_whole_sphere_is_believed_but_behind_and_at_its_poles(imported):
    text = MRCAL.replace("OPENCV5", "LONLAT").replace(
        ", ".join(map(repr, CORE + DISTORTION)), f"{640 / 2 / np.pi}, {480 / np.pi}, 319.5, 239.5"
    )
    adopted = imported(text)
    camera = adopted.calibration.camera
    assert 0.6 < adopted.covered < 0.95
    assert camera.inside(np.array([[319.5, 239.5], [600.0, 239.5]])).all()
    assert not camera.inside(np.array([[639.0, 239.5], [319.5, 0.0]])).any()
    pixels = PIXELS[camera.inside(PIXELS)]
    longitude, latitude = ((pixels - [319.5, 239.5]) / [640 / 2 / np.pi, 480 / np.pi]).T
    expected = np.stack(
        [np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)], axis=1
    )
    assert np.abs(camera.to_rays(pixels).directions - expected).max() < 1e-4


# --- what is chosen and refused ---


def test_one_camera_of_a_chain(imported):
    assert imported(KALIBR, camera="cam1").calibration.trend == "ds-none"
    with pytest.raises(CameraFileError, match="holds 2 cameras; name the one to import: cam0 or cam1"):
        imported(KALIBR)
    with pytest.raises(CameraFileError, match="holds no camera 'cam2'; it holds: cam0, cam1"):
        imported(KALIBR, camera="cam2")


def test_four_coefficients_need_a_word(imported):
    zeros = OPENCV.replace(", ".join(map(repr, DISTORTION)), "0., 0., 0., 0.").replace("rows: 5", "rows: 4")
    assert imported(zeros).calibration.trend == "4 coefficients"  # of no lens: either model is the pinhole
    text = OPENCV.replace(f", {DISTORTION[4]!r} ]", " ]").replace("rows: 5", "rows: 4")
    with pytest.raises(CameraFileError, match="specify whether they are fisheye coefficients"):
        imported(text)
    assert imported(text, fisheye=False).calibration.trend == "4 coefficients"
    assert imported(text, fisheye=True).calibration.trend == "fisheye"
    assert imported(text + "fisheye_model: 1\n").calibration.trend == "fisheye"


def test_a_size_that_the_file_lacks(imported):
    text = "\n".join(line for line in OPENCV.splitlines() if not line.startswith("image_"))
    with pytest.raises(CameraFileError, match="does not contain the size of the images; give the image size"):
        imported(text)
    assert imported(text, image_size=(320, 240)).calibration.camera.image_size == (320, 240)
    with pytest.raises(CameraFileError, match="for images of 640x480, not of the given size"):
        imported(OPENCV, image_size=(320, 240))


def test_a_board_for_evaluation(tmp_path):
    (tmp_path / "a").write_text(ROS)
    theirs = read_foreign(tmp_path / "a")
    assert adopt(theirs).calibration.details["board_known"] is False
    calibration = adopt(theirs, board=Checkerboard(9, 6), square_mm=25.0).calibration
    assert calibration.details["board_known"] is True
    assert (calibration.corner_set.board, calibration.square_mm) == (Checkerboard(9, 6), 25.0)


def changed(text, old, new):
    assert old in text
    return text.replace(old, new)


BROKEN = {
    "empty": ("", "not a camera of another program"),
    "words": ("hello world", "not a camera of another program"),
    "another yaml": ("a: 1\nb: 2\n", "not a camera of mrcal, OpenCV, Kalibr or ROS"),
    "cut short": (MRCAL[:200], "not a camera of another program"),
    "code": ("{'lensmodel': __import__('os').getcwd()}", "not a camera of another program"),
    "deep": ("{'lensmodel': " + "[" * 5000 + "]" * 5000 + "}", "not a camera of another program"),
    "signs": ("{'lensmodel': " + "-" * 200_000 + "1}", "not a camera of another program"),
    "a list": ("- 1\n- 2\n", "not a camera of another program"),
    "no intrinsics": ("{'lensmodel': 'LENSMODEL_PINHOLE', 'imagersize': [6, 4]}", "it has no intrinsics"),
    "few intrinsics": ("{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [1.0]}", "1 intrinsics where 4 or more"),
    "texts": ("{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': ['a', 'b']}", "not all of its intrinsics are numbers"),
    "cahvore": (changed(MRCAL, "OPENCV5", "CAHVORE_linearity=0.3"), "model CAHVORE_linearity=0.3 is not supported"),
    "too many": (changed(MRCAL, "OPENCV5", "OPENCV4"), "5 distortion coefficients where 4 are needed"),
    "knots": (changed(MRCAL, "OPENCV5", "SPLINED_STEREOGRAPHIC_order=3_Nx=9_Ny=9_fov_x_deg=90"), "where 162 are"),
    "wide": (changed(MRCAL, "OPENCV5", "SPLINED_STEREOGRAPHIC_order=3_Nx=9_Ny=9_fov_x_deg=400"), "are not valid"),
    "infinite": (changed(ROS, "420.0, 0, 325.4", ".inf, 0, 325.4"), "not all of its matrix entries are numbers"),
    "overflow": (changed(ROS, "420.0, 0, 325.4", "1e999, 0, 325.4"), "not all of its matrix entries are finite"),
    "more columns": (changed(ROS, "cols: 5", "cols: 9"), "a matrix of 1x9 has 5 numbers"),
    "fewer rows": (changed(OPENCV, "rows: 5", "rows: 4"), "a matrix of 4x1 has 5 numbers"),
    "skew": (changed(ROS, "420.0, 0, 325.4", "420.0, 3, 325.4"), "not that of a camera without skew"),
    "ros model": (changed(ROS, "plumb_bob", "magic"), "distortion model magic is not supported"),
    "kalibr model": (changed(KALIBR, "radtan", "magic"), "model pinhole-magic is not supported"),
    "no size": (changed(ROS, "image_height: 480", ""), "does not contain the size"),
    "large": (changed(ROS, "image_height: 480", "image_height: 99999999"), "for images of 640x99999999"),
    "doctype": ("<!DOCTYPE a><opencv_storage></opencv_storage>", "not a camera of another program"),
}


@pytest.mark.parametrize(("text", "sentence"), BROKEN.values(), ids=BROKEN)
def test_broken_files_are_refused_in_a_sentence(imported, text, sentence):
    with pytest.raises(CameraFileError) as refused:
        imported(text)
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300


def test_bytes_and_missing_files_are_refused(tmp_path):
    (tmp_path / "a").write_bytes(bytes(range(256)))
    with pytest.raises(CameraFileError, match="not text in UTF-8"):
        read_foreign(tmp_path / "a")
    with pytest.raises(CameraFileError, match="there is no file"):
        read_foreign(tmp_path / "b")


def test_cameras_that_see_nothing_or_wildly_are_refused():
    with pytest.raises(CalibrationError, match="covers next to nothing of an image of 640x480"):
        adopt(foreign(lambda xyz: np.full((len(xyz), 2), np.nan)))
    with pytest.raises(CalibrationError, match="covers next to nothing of an image of 640x480"):
        adopt(foreign(lambda xyz: xyz[:, :2] / xyz[:, 2:] * 300.0 + 1e6))
    rough = np.random.default_rng(0).normal(0, 20.0, (40, 40, 2))

    def jumps(xyz):
        pixels = xyz[:, :2] / np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan) * 300.0 + [319.5, 239.5]
        cell = np.clip(np.nan_to_num(pixels) / 20.0, 0, 39).astype(int)
        return pixels + rough[cell[:, 1], cell[:, 0]]

    with pytest.raises(CalibrationError, match="covers next to nothing"):
        adopt(foreign(jumps))


def test_what_no_spline_repeats_is_left_out():
    def dented(xyz):
        with np.errstate(invalid="ignore"):
            pixels = xyz[:, :2] / np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan) * 300.0 + [319.5, 239.5]
        return pixels + np.where(pixels[:, :1] > 500.0, 0.4 * np.sin(pixels), 0.0)

    adopted = adopt(foreign(dented))
    assert adopted.largest_px < 0.05
    assert 0.6 < adopted.covered < 0.8  # 500 of 640 columns
    assert not adopted.calibration.camera.inside(np.array([[560.0, 240.0]]))[0]


@settings(max_examples=120, deadline=None)
@given(
    name=st.sampled_from(sorted(FILES)),
    cuts=st.lists(st.tuples(st.integers(0, 1500), st.integers(0, 12)), min_size=1, max_size=4),
    filling=st.text("0123456789.eE+-[]{}:,'\"<>/!# \nabn", max_size=8),
)
def test_damaged_files_are_read_or_refused_and_nothing_else(name, cuts, filling, tmp_path_factory):
    """Whatever bytes are lost or put in: a camera, or an error with one sentence."""
    text = FILES[name]
    for place, length in cuts:
        text = text[:place] + filling + text[place + length :]
    path = tmp_path_factory.getbasetemp() / "damaged"
    path.write_text(text, encoding="utf-8")
    sentence, seen = "", np.empty((0, 2))
    try:
        seen = read_foreign(path, fisheye=False, image_size=SIZE).project(np.array([[0.1, 0.2, 1.0]]))
    except CameraFileError as error:
        sentence = str(error)
    assert seen.shape == (1, 2) or sentence
    assert "\n" not in sentence
