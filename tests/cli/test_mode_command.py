"""``pinholify mode``: one calibration, every mode of the sensor."""

import numpy as np
import pytest

from pinholify.io.camera_file import read_camera
from pinholify.io.images import write_image


@pytest.fixture
def half(run, camera, tmp_path):
    """The camera file of half the resolution."""
    target = tmp_path / "half.npz"
    answer = run("mode", camera, "--size", "320x240", "-o", target)
    assert (answer.status, answer.err) == (0, "")
    assert answer.out.endswith("images of 320x240, calibrated at 640x480\n")
    return target


def test_a_pixel_has_the_ray_of_its_place_on_the_sensor(run, camera, tmp_path):
    target = tmp_path / "mode.npz"
    assert run("mode", camera, "--crop", "20,40,600x360", "--bin", "2", "--size", "150x90", "-o", target).status == 0
    uv = np.array([[30.0, 20.0], [100.0, 70.0]])
    mode, whole = read_camera(target), read_camera(camera)
    place = 4.0 * (uv + 0.5) - 0.5 + [20.0, 40.0]
    np.testing.assert_allclose(mode.camera.to_rays(uv).directions, whole.camera.to_rays(place).directions, atol=1e-12)
    assert mode.corner_set.image_size == (150, 90)
    assert mode.square_mm == whole.square_mm


def test_images_of_the_mode_and_of_no_other_are_straightened(run, refused, half, tmp_path):
    for name, shape in (("small", (240, 320)), ("large", (480, 640))):
        write_image(tmp_path / f"{name}.png", np.full(shape, 200, np.uint8))
    assert run("undistort", half, tmp_path / "small.png", "-o", tmp_path / "out").status == 0
    sentence = refused("undistort", half, tmp_path / "large.png", "-o", tmp_path / "out")
    assert sentence.endswith("or make the camera of this mode with 'pinholify mode'")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--size", "320x200"], "do not have the proportions"),
        (["--crop", "100,0,600x480"], "is not inside the camera's image of 640x480"),
        (["--bin", "1000"], "give an integer factor from 1 to 480"),
    ],
)
def test_no_mode_of_the_sensor(words, sentence, refused, camera, tmp_path):
    assert sentence in refused("mode", camera, *words, "-o", tmp_path / "m.npz")
    assert not (tmp_path / "m.npz").exists()


@pytest.mark.parametrize("words", [[], ["--crop", "10,10"], ["--crop", "-1,0,20x20"], ["--bin", "0"]])
def test_wrong_usage(words, run, camera, tmp_path):
    assert run("mode", camera, *words, "-o", tmp_path / "m.npz").status == 2


def test_the_camera_itself_is_not_replaced(refused, camera):
    assert "is one of the inputs" in refused("mode", camera, "--bin", "2", "-o", camera, "--force")


def test_a_start_of_the_old_mode_is_not_kept(run, camera, table):
    words = ("--board", "9x6", "--image-size", "640x480", "--trend", "plane:1", "--no-opencv", "--no-heldout")
    assert run("calibrate", "--corners", table, *words, "--start", camera, "-o", "led.npz").status == 0
    assert run("mode", "led.npz", "--bin", "2", "-o", "half.npz").status == 0
    led, half = (read_camera(name).settings for name in ("led.npz", "half.npz"))
    assert led.start is not None
    assert half.start is None
    assert (half.method, half.trend) == (led.method, led.trend) == ("joint", "plane:1")
