"""Other modes of a calibrated sensor: the same rays from the same places."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pinholify.camera import Domain
from pinholify.errors import ImageError, InputError
from pinholify.geometry import ConvexRegion
from pinholify.io.camera_file import read_camera, write_camera
from pinholify.modes import SensorMode, binned, cropped, scaled
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.straightener import Straightener

FULL = (1920, 1200)  # of the shared camera
MODES = {
    "crop": (lambda camera: cropped(camera, 300, 200, (1200, 800)), (1200, 800), 1.0),
    "binning": (lambda camera: binned(camera, 2), (960, 600), 2.0),
    "scaling": (lambda camera: scaled(camera, (1280, 800)), (1280, 800), 1.5),
    "enlarging": (lambda camera: scaled(camera, (3840, 2400)), (3840, 2400), 0.5),
    "crop of a binning": (lambda camera: cropped(binned(camera, 2), 150, 100, (600, 400)), (600, 400), 2.0),
}


@pytest.fixture(params=MODES)
def mode(request, barrel_calibration):
    """A mode's camera, its size, and how many calibrated px its pixel measures."""
    make, size, scale = MODES[request.param]
    return make(barrel_calibration.camera), size, scale


def places(size):
    return np.random.default_rng(0).uniform([0.3, 0.3], [0.7, 0.7], (40, 2)) * size


def test_rays_are_those_of_the_same_place_on_the_sensor(mode, barrel_calibration):
    camera, size, scale = mode
    full = barrel_calibration.camera
    uv = places(size)
    there = camera.plane_map.calibrated(uv)
    mine, its = camera.to_rays(uv), full.to_rays(there)
    np.testing.assert_allclose(mine.directions, its.directions, atol=1e-12)
    np.testing.assert_allclose(mine.std_px * scale, its.std_px, rtol=1e-9)
    np.testing.assert_allclose(camera.to_virtual(uv).covariance, full.to_virtual(there).covariance, rtol=1e-6)
    np.testing.assert_array_equal(camera.inside(uv), full.inside(there))
    assert camera.image_size == size
    assert camera.noise_px * scale == pytest.approx(full.noise_px)
    assert camera.chart is full.chart


@pytest.mark.parametrize("name", MODES)
def test_a_limit_of_the_std_holds_on_the_same_places(barrel_calibration, name):
    make, size, _ = MODES[name]
    full = barrel_calibration.camera
    wide = ConvexRegion(np.array([[0.0, 0.0], [1919, 0], [1919, 1199], [0, 1199]]))
    uv = places(size)
    std = full.shape_std(make(full).plane_map.calibrated(uv))
    limited = replace(full, domain=Domain(wide, float(np.median(std))))
    np.testing.assert_array_equal(make(limited).inside(uv), std <= np.median(std))


def test_there_and_back(mode):
    camera, size, _ = mode
    np.testing.assert_allclose(camera.project(camera.to_rays(places(size)).directions), places(size), atol=1e-5)


def test_the_jacobian_is_that_of_the_map(mode):
    camera, size, _ = mode
    uv, step = places(size), 1e-2
    numeric = [
        (camera.plane_map.value(uv + e) - camera.plane_map.value(uv - e)) / (2 * step) for e in np.eye(2) * step
    ]
    np.testing.assert_allclose(camera.plane_map.jacobian(uv), np.stack(numeric, -1), atol=1e-7)


def blob(centre):
    y, x = np.mgrid[0:1200, 0:1920]
    return np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (2 * 12.0**2))


def centroid(image):
    y, x = np.mgrid[0 : image.shape[0], 0 : image.shape[1]]
    return np.array([(image * x).sum(), (image * y).sum()]) / image.sum()


@pytest.mark.parametrize(
    ("make", "resample"),
    [
        (MODES["crop"][0], lambda image: image[200:1000, 300:1500]),
        (MODES["binning"][0], lambda image: image.reshape(600, 2, 960, 2).mean(axis=(1, 3))),
        (MODES["scaling"][0], lambda image: cv2.resize(image, (1280, 800), interpolation=cv2.INTER_AREA)),
        (MODES["enlarging"][0], lambda image: cv2.resize(image, (3840, 2400), interpolation=cv2.INTER_LINEAR)),
        (lambda camera: binned(camera, 7), lambda image: image[:1197, :1918].reshape(171, 7, 274, 7).mean((1, 3))),
    ],
)
def test_pixels_are_where_the_image_shows_them(barrel_calibration, make, resample):
    """A spot of the calibrated image, found again in the resampled one."""
    centre = np.array([903.3, 711.8])
    seen = centroid(resample(blob(centre)))
    mapped = make(barrel_calibration.camera).plane_map.calibrated(seen[None])[0]
    np.testing.assert_allclose(mapped, centre, atol=0.01)


def test_modes_of_modes_stay_one_step_deep(barrel_calibration):
    camera = cropped(scaled(cropped(barrel_calibration.camera, 300, 200, (1200, 800)), (600, 400)), 10, 20, (500, 300))
    assert isinstance(camera.plane_map, SensorMode)
    assert camera.plane_map.plane_map is barrel_calibration.camera.plane_map
    np.testing.assert_allclose(camera.plane_map.calibrated(np.array([[0.0, 0.0]])), [[320.5, 240.5]])


def test_a_mode_straightens_its_own_images_only(barrel_calibration):
    straighten = Straightener(binned(barrel_calibration.camera, 4), ViewOptions(size=(240, 150)))
    assert straighten(np.full((300, 480), 200, np.uint8)).max() == 200
    with pytest.raises(ImageError, match="1920x1200 and the camera was calibrated at 480x300"):
        straighten(np.zeros((1200, 1920), np.uint8))


def test_a_mode_is_kept_in_a_camera_file(barrel_calibration, tmp_path):
    camera = binned(barrel_calibration.camera, 2)
    write_camera(tmp_path / "c.npz", replace(barrel_calibration, camera=camera))
    read = read_camera(tmp_path / "c.npz").camera
    uv = places((960, 600))
    np.testing.assert_array_equal(read.to_rays(uv).directions, camera.to_rays(uv).directions)
    assert read.image_size == (960, 600)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda c: cropped(c, 1000, 0, (921, 600)), "921x600 from column 1000 and row 0 is not inside .* 1920x1200"),
        (lambda c: cropped(c, -1, 0, (100, 100)), "column -1"),
        (lambda c: cropped(c, 0, 1150, (100, 51)), "row 1150"),
        (lambda c: cropped(c, 0, 0, (0, 10)), "0x10"),
        (lambda c: scaled(c, (1920, 1080)), "1920x1080 do not have the proportions of the camera's 1920x1200"),
        (lambda c: scaled(c, (640, 398)), "640x398"),
        (lambda c: scaled(c, (0, 0)), "0x0"),
        (lambda c: binned(c, 0), "0x0 binning"),
        (lambda c: binned(c, 1201), "1201x1201 binning"),
    ],
)
def test_sizes_that_do_not_fit_are_refused(barrel_calibration, make, sentence):
    with pytest.raises(InputError, match=sentence):
        make(barrel_calibration.camera)


def test_sizes_that_were_rounded_fit(barrel_calibration):
    assert scaled(barrel_calibration.camera, (853, 533)).image_size == (853, 533)
