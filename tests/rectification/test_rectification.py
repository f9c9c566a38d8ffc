"""Views and maps: exact where they say so, straight lines straight, and every kind of image kept."""

import numpy as np
import pytest

from pinholify.errors import ImageError, InputError
from pinholify.expansion import expand
from pinholify.rectification.maps import rectification_map
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.straightener import Straightener
from pinholify.rectification.valid_region import source_mask, valid_pixels
from pinholify.rectification.views import named_view, share_outside
from synthetic import FOCAL, SIZE, TRUE_F, project

SQUEEZE = 0.15


def test_an_expansion_is_exact_within_its_tolerance():
    def bent(p):
        return p + 20 * np.sin(p[:, ::-1] / 90.0)

    out = np.moveaxis(expand(bent, (700, 400), tolerance=0.001), 0, -1)
    grid = np.stack(np.meshgrid(np.arange(700.0), np.arange(400.0)), -1)
    error = out - bent(grid.reshape(-1, 2)).reshape(grid.shape)
    assert np.abs(error).max() < 0.002


def test_an_expansion_divides_what_one_polynomial_cannot_follow():
    def wavy(p):
        return p + 5 * np.sin(p[:, ::-1] / 12.0)

    out = np.moveaxis(expand(wavy, (700, 400), tolerance=0.001), 0, -1)
    grid = np.stack(np.meshgrid(np.arange(700.0), np.arange(400.0)), -1)
    assert np.abs(out - wavy(grid.reshape(-1, 2)).reshape(grid.shape)).max() < 0.002


def test_what_may_not_be_believed_is_black(barrel_calibration):
    straighten = Straightener(barrel_calibration.camera, ViewOptions(size=(480, 300)))
    valid = rectification_map(barrel_calibration.camera, straighten.view).valid
    out = straighten(np.full((SIZE[1], SIZE[0]), 200, np.uint8))
    assert 0.02 < (~valid).mean() < 0.5
    np.testing.assert_array_equal(out > 0, valid)


@pytest.mark.parametrize("name", ["camera", "board"])
def test_all_that_is_known_and_the_corners_that_told_it_lie_in_the_view(barrel_calibration, name):
    camera = barrel_calibration.camera
    view = named_view(camera, ViewOptions(name))
    used = np.concatenate([v.uv for v in barrel_calibration.corner_set.found])
    known = np.argwhere(source_mask(camera, None))[::97, ::-1].astype(float)
    for uv in (used[valid_pixels(camera, used, None)], known):
        seen = view.project(camera.to_rays(uv).directions)
        assert len(seen) > 100
        assert (seen >= -0.5).all()
        assert (seen <= np.array(SIZE) - 0.5).all()
    assert share_outside(camera, view, None) == 0.0


def test_an_expansion_goes_around_what_has_no_answer():
    def half(p):
        return np.where((p[:, :1] + p[:, 1:] < 300), p, np.nan)

    out = np.moveaxis(expand(half, (400, 300)), 0, -1)
    grid = np.stack(np.meshgrid(np.arange(400.0), np.arange(300.0)), -1)
    known = grid.sum(axis=2) < 300
    np.testing.assert_array_equal(np.isfinite(out).all(axis=2), known)
    np.testing.assert_allclose(out[known], grid[known], atol=1e-3)


@pytest.mark.parametrize("name", ["camera", "board"])
def test_a_map_is_the_inverse_of_the_camera(barrel_calibration, name):
    camera = barrel_calibration.camera
    view = named_view(camera, ViewOptions(name, size=(640, 400)))
    made = rectification_map(camera, view)
    y, x = np.nonzero(made.valid)
    chosen = np.random.default_rng(0).choice(len(x), 300)
    pixels = np.column_stack([x, y])[chosen].astype(float)
    exact = camera.project(view.directions(pixels))
    assert np.abs(made.uv[y[chosen], x[chosen]] - exact).max() < 0.01
    assert made.valid.mean() > 0.5


def test_the_camera_view_looks_along_the_axis_and_the_board_view_at_the_board(barrel_calibration):
    camera = barrel_calibration.camera
    board = named_view(camera, ViewOptions("board"))
    np.testing.assert_array_equal(board.rotation, np.eye(3))
    along = named_view(camera)
    centre = camera.to_rays((np.array([SIZE]) - 1) / 2.0).directions
    np.testing.assert_allclose(along.rotation @ centre[0], [0, 0, 1], atol=1e-9)
    assert np.linalg.det(along.rotation) == pytest.approx(1.0)


def lines_picture():
    """Vertical white lines of a distant plane seen through the barrel lens, by exact inversion of the lens."""
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    d = (np.stack([x, y], -1) - (np.array(SIZE) - 1) / 2.0) / FOCAL
    r = np.hypot(d[..., 0], d[..., 1]) + 1e-12
    rho = (1 - np.sqrt(1 - 4 * SQUEEZE * r**2)) / (2 * SQUEEZE * r)
    plane_x = d[..., 0] / r * rho * TRUE_F
    return (127 + 120 * np.cos(2 * np.pi * plane_x)).clip(0, 255).astype(np.uint8)


def test_straight_lines_become_straight(barrel_calibration):
    camera = barrel_calibration.camera
    straighten = Straightener(camera, ViewOptions("board"))
    straight = straighten(lines_picture()).astype(float)
    middle = straight[500:700].mean(axis=0)
    for row in (250, 400, 800, 950):
        band = straight[row - 5 : row + 5].mean(axis=0)
        seen = (band > 0) & (middle > 0)
        assert np.abs(band - middle)[seen].mean() < 6.0


@pytest.mark.parametrize("method", ["remap", "splat"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_depth_and_channels_are_kept(barrel_calibration, method, dtype, channels):
    shape = (SIZE[1], SIZE[0]) if channels == 1 else (SIZE[1], SIZE[0], channels)
    image = np.full(shape, np.iinfo(dtype).max // 2, dtype=dtype)
    out = Straightener(barrel_calibration.camera, ViewOptions("board", size=(480, 300)), method=method)(image)
    assert out.dtype == dtype
    assert out.shape == (300, 480, *shape[2:])
    assert set(np.unique(out)) <= {0, np.iinfo(dtype).max // 2}
    assert (out > 0).mean() > 0.5


def test_splat_and_remap_show_the_same(barrel_calibration):
    picture = lines_picture()
    remapped, splatted = (
        Straightener(barrel_calibration.camera, ViewOptions("board", size=(960, 600)), method=m)(picture).astype(float)
        for m in ("remap", "splat")
    )
    both = (remapped > 0) & (splatted > 0)
    assert both.mean() > 0.6
    assert np.abs(remapped - splatted)[both].mean() < 8.0


def test_a_std_limit_shows_more_or_less(barrel_calibration):
    camera = barrel_calibration.camera
    view = named_view(camera, ViewOptions(size=(320, 200), max_std=50.0))
    shown = [rectification_map(camera, view, max_std=limit).valid.mean() for limit in (0.05, 1.0)]
    assert shown[0] < shown[1]


def test_an_image_of_another_size_is_refused(barrel_calibration):
    with pytest.raises(ImageError, match="640x480 and the camera was calibrated at 1920x1200"):
        Straightener(barrel_calibration.camera)(np.zeros((480, 640), np.uint8))


def test_unknown_views_and_methods_are_refused(barrel_calibration):
    with pytest.raises(InputError, match=r"unknown view 'moon': choose one of camera, board"):
        ViewOptions("moon")
    with pytest.raises(InputError, match=r"unknown method 'magic': choose one of remap, splat"):
        Straightener(barrel_calibration.camera, method="magic")


def test_the_picture_is_taken_through_the_calibrated_lens():
    """Its inversion undoes the lens of the corners."""
    points = np.array([[1.0, 0.5, TRUE_F]])
    uv = project(points, SQUEEZE)[0]
    d = (uv - (np.array(SIZE) - 1) / 2) / FOCAL
    r = np.hypot(*d)
    rho = (1 - np.sqrt(1 - 4 * SQUEEZE * r**2)) / (2 * SQUEEZE * r)
    np.testing.assert_allclose(d / r * rho * TRUE_F, [1.0, 0.5])
