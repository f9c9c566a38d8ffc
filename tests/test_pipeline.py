"""The choice of the method, and the settings with which a camera is made again from other corners."""

import dataclasses

import numpy as np
import pytest

from pinholify.errors import InputError
from pinholify.evaluation.summary import evaluate
from pinholify.io.camera_file import read_camera, write_camera
from pinholify.pipeline import calibrate, method_knowing, recalibrate
from pinholify.report.evaluated import evaluated
from synthetic import corner_set

CORNERS = corner_set(8, squeeze=0.15)
PART = CORNERS.with_views(CORNERS.views[:6])
UV = np.array([[300.0, 200.0], [960.0, 600.0], [1500.0, 900.0]])


@pytest.mark.parametrize(
    ("options", "method"),
    [
        ({"trend": "lens:2"}, "one-image"),
        ({"trend": "constant"}, "one-image"),
        ({"trend": "lens:2", "kernel": "rq"}, "one-image"),
        ({"trend": "plane:1"}, "joint"),
    ],
)
def test_auto_is_the_method_that_knows_the_kernel_and_the_trend(options, method):
    few = CORNERS.with_views(CORNERS.views[:3])
    for corners in (CORNERS, few):
        assert calibrate(corners, reference="view0.png", **options).method == method


def test_names_that_no_method_knows_are_refused_with_both_reasons():
    assert method_knowing("auto", "se", "auto") == "auto"
    with pytest.raises(InputError, match=r"the joint refinement has no trend 'cubic'.*; unknown trend 'cubic'"):
        calibrate(CORNERS, trend="cubic")
    with pytest.raises(InputError, match=r"the joint refinement has no kernel 'rq'.*; unknown trend 'plane:1'"):
        calibrate(CORNERS, kernel="rq", trend="plane:1")
    with pytest.raises(InputError, match=r"^the joint refinement has no trend 'lens:2'"):
        calibrate(CORNERS, method="joint", trend="lens:2")
    with pytest.raises(InputError, match="unknown method 'paper'"):
        calibrate(CORNERS, method="paper")


@pytest.mark.parametrize("side", [-5.0, 0.0, float("nan"), float("inf")])
def test_the_side_of_a_square_is_a_length(side):
    with pytest.raises(InputError, match="must be positive"):
        calibrate(CORNERS, square_mm=side)


@pytest.mark.parametrize("options", [{"trend": "plane:1"}, {"trend": "lens:1"}])
def test_every_method_tells_its_progress(options):
    lines = []
    calibrate(CORNERS, reference="view0.png", progress=lines.append, **options)
    assert any("noise" in line for line in lines)
    assert all(line and "\n" not in line for line in lines)


@pytest.mark.parametrize(
    "options",
    [
        {"method": "joint", "trend": "plane:1", "kernel": "matern52"},
        {"method": "one-image", "trend": "lens"},
        {"method": "one-image", "trend": "constant"},
    ],
)
def test_other_corners_are_calibrated_as_the_camera_was_also_from_its_file(tmp_path, options):
    calibration = calibrate(CORNERS, reference="view0.png", square_mm=20.0, **options)
    write_camera(tmp_path / "camera.npz", calibration)
    wanted = calibrate(PART, reference="view0.png", **options).camera.to_rays(UV).directions
    for each in (calibration, read_camera(tmp_path / "camera.npz")):
        again = recalibrate(each, PART, "view0.png")
        np.testing.assert_array_equal(again.camera.to_rays(UV).directions, wanted)
        assert dataclasses.astuple(again.settings) == dataclasses.astuple(calibration.settings)


def test_a_start_is_kept_in_the_file(tmp_path):
    start = calibrate(PART, reference="view0.png", trend="plane:1").camera
    calibration = calibrate(CORNERS, reference="view0.png", trend="plane:1", start=start)
    write_camera(tmp_path / "camera.npz", calibration)
    again = recalibrate(read_camera(tmp_path / "camera.npz"), PART, "view0.png")
    assert again.details["start_fits"] is True
    np.testing.assert_array_equal(again.settings.start.to_rays(UV).directions, start.to_rays(UV).directions)


def test_few_boards_of_a_joint_camera_are_calibrated_jointly():
    calibration = calibrate(CORNERS, reference="view0.png", trend="plane:1")
    few = dataclasses.replace(calibration, settings=dataclasses.replace(calibration.settings, trend="auto"))
    assert recalibrate(few, CORNERS.with_views(CORNERS.views[:3]), "view0.png").method == "joint"


def test_where_settings_are_unknown_they_are_taken_from_the_camera():
    joint = calibrate(CORNERS, reference="view0.png", trend="plane:1")
    one_image = calibrate(CORNERS, reference="view0.png", trend="lens:2")
    for calibration, trend in ((joint, "auto"), (one_image, one_image.trend)):
        again = recalibrate(dataclasses.replace(calibration, settings=None), PART, "view0.png")
        settings = again.settings
        assert (settings.method, settings.kernel, settings.trend, settings.mirrored, settings.start) == (
            calibration.method, "se", trend, False, None
        )
    with pytest.raises(InputError, match="unknown method 'imported'"):
        recalibrate(dataclasses.replace(joint, method="imported", settings=None), PART, "view0.png")


def test_reports_and_evaluations_hold_out_alike(tmp_path):
    """With a trend that is not the best, so that it shows whether the same one was used."""
    calibration = calibrate(CORNERS, reference="view0.png", method="joint", trend="polynomial:3")
    write_camera(tmp_path / "camera.npz", calibration)
    read = read_camera(tmp_path / "camera.npz")

    def by_hand(part, reference):
        return calibrate(part, reference=reference, method="joint", trend="polynomial:3")

    wanted = evaluate(calibration, CORNERS, recalibrate=by_hand, compare_opencv=False).heldout_px
    assert evaluated(read, opencv=False)[0].heldout_px == wanted


def test_corners_outside_the_image_are_refused():
    small = dataclasses.replace(CORNERS, image_size=(960, 600))
    u, v = next(uv for view in CORNERS.views for uv in view.uv if (uv > (960, 600)).any())
    with pytest.raises(InputError) as refused:
        calibrate(small)
    assert str(refused.value) == (
        f"'view0.png' has a corner at ({u:.1f}, {v:.1f}), outside an image of 960x600: "
        "give the size of the photographs as image_size"
    )
    assert not CORNERS.outside
    edge = dataclasses.replace(CORNERS.views[0], uv=np.clip(CORNERS.views[0].uv, 100.0, None) - 100.9)
    assert not CORNERS.with_views([edge]).outside


def test_a_wrong_corner_outside_the_image_is_no_wrong_image_size():
    uv = np.array(CORNERS.views[3].uv)
    uv[7] = -40.0, 1e4
    spoilt = CORNERS.with_views(
        dataclasses.replace(view, uv=uv) if k == 3 else view for k, view in enumerate(CORNERS.views)
    )
    found = calibrate(spoilt)
    assert CORNERS.views[3].ids[7] in found.findings.wrong_corners[CORNERS.views[3].name]
