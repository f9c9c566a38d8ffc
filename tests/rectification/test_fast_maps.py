"""Maps of whole pictures against the exact inverse, on exact lenses; sampling with them; their standard deviation."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import AngleChart, Intrinsics, angles_to_directions, directions_to_angles
from pinholify.geometry import convex_hull
from pinholify.rectification.maps import rectification_map, remap, sampler
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.valid_region import source_mask
from pinholify.rectification.views import named_view
from pinholify.simulation.lenses import LENSES, Fisheye, Pinhole, Resized

NAMES = ("pinhole", "unity-barrel", "unity-pincushion", "rational-prism-tilt", "fisheye", "windscreen")
VIEW_SIZE = (1500, 900)


class LensMap:
    """A simulated lens as the map of a virtual camera, in the place of a learnt one: what it says is the truth."""

    def __init__(self, lens):
        self.lens = lens

    def value(self, uv):
        return directions_to_angles(self.lens.unproject(uv).directions)

    def jacobian(self, uv):
        ends = [self.value(uv + e) - self.value(uv - e) for e in np.eye(2) * 0.5]
        return np.stack(ends, axis=-1)

    def covariance_up_to_turn(self, uv):
        jacobian = self.jacobian(uv)
        return (self.std(uv) ** 2)[:, None, None] * (jacobian @ jacobian.transpose(0, 2, 1))

    def inverse(self, q, nearby):
        return self.lens.project(angles_to_directions(q))

    @staticmethod
    def std(uv):
        return 0.02 * np.exp(np.linalg.norm(uv - [300.0, 200.0], axis=1) / 500.0)


def camera_of(lens, max_std=np.inf):
    width, height = lens.size
    frame = np.array([[0.0, 0.0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]])
    domain = Domain(convex_hull(frame), max_std)
    return VirtualCamera(LensMap(lens), AngleChart(np.eye(3), Intrinsics(9.0, 0.0, 0.0)), domain, lens.size, 0.1)


def checked(valid):
    """Pixels at random, on all edges of the picture, and along the border of what is valid."""
    height, width = valid.shape
    rng, x, y = np.random.default_rng(0), np.arange(width), np.arange(height)
    edges = [np.column_stack([x, np.full(width, e)]) for e in (0, height - 1)]
    edges += [np.column_stack([np.full(height, e), y]) for e in (0, width - 1)]
    border = valid & ~cv2.erode(valid.view(np.uint8), np.ones((3, 3))).view(bool)
    pixels = np.concatenate([rng.integers(0, [width, height], (2000, 2)), *edges, np.argwhere(border)[:, ::-1]])
    return pixels[valid[pixels[:, 1], pixels[:, 0]]][::2]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("view_name", ["camera", "equirectangular"])
def test_a_map_is_right_to_a_hundredth_of_a_pixel(name, view_name):
    """Also at the edges; of images as large as those of a 4K camera."""
    lens = Resized(LENSES[name], tuple(3 * n for n in LENSES[name].size))
    camera = camera_of(lens)
    view = named_view(camera, ViewOptions(view_name, size=VIEW_SIZE))
    made = rectification_map(camera, view)
    assert made.valid.mean() > 0.3
    pixels = checked(made.valid)
    exact = lens.project(view.directions(pixels.astype(float)))
    assert np.linalg.norm(made.uv[pixels[:, 1], pixels[:, 0]] - exact, axis=1).max() < 0.01


@pytest.fixture(scope="module")
def pinhole():
    return camera_of(Pinhole((640, 400), 450.0, (4.0, -3.0)), max_std=0.05)


def test_what_is_valid_is_what_may_be_believed(pinhole):
    view = named_view(pinhole, ViewOptions(size=(500, 400), fov=80.0))
    made = rectification_map(pinhole, view)
    exact = pinhole.project(view.directions(np.argwhere(np.ones((400, 500)))[:, ::-1].astype(float)))
    inside = ((exact > 0) & (exact < np.array([639, 399]))).all(axis=1)
    sure = np.abs(pinhole.plane_map.std(exact) / 0.05 - 1.0) > 0.02
    believed = inside & (pinhole.plane_map.std(exact) < 0.05)
    np.testing.assert_array_equal(made.valid.ravel()[sure & inside], believed[sure & inside])
    assert 0.2 < believed.mean() < 0.8


def test_the_standard_deviation_of_every_pixel(pinhole):
    view = named_view(pinhole, ViewOptions(size=(500, 400), fov=80.0))
    made = rectification_map(pinhole, view, with_std=True)
    inside = ((made.uv >= 0) & (made.uv <= [639, 399])).all(axis=2)
    truth = pinhole.plane_map.std(made.uv[inside].astype(float))
    np.testing.assert_allclose(made.std[inside], truth, rtol=0.03)
    outside = ((made.uv < -1) | (made.uv > [640, 400])).any(axis=2)
    assert outside.any()
    assert np.isnan(made.std[outside]).all()
    assert rectification_map(pinhole, view).std is None


def test_a_limit_replaces_the_domains(pinhole):
    std = pinhole.plane_map.std(np.argwhere(np.ones((400, 640)))[:, ::-1].astype(float)).reshape(400, 640)
    for limit in (None, 0.03, 0.08):
        mask, level = source_mask(pinhole, limit), limit or 0.05
        sure = np.abs(std / level - 1.0) > 0.02
        np.testing.assert_array_equal(mask[sure], (std <= level)[sure])


def gradient_picture(size):
    """Red grows with the column and green with the row, in steps that a byte holds."""
    v, u = np.mgrid[0 : size[1], 0 : size[0]].astype(np.float32)
    return np.stack([u / size[0] * 200 + 20, v / size[1] * 200 + 20], axis=2).astype(np.uint8)


@pytest.mark.parametrize("fixed_point", [False, True])
def test_sampling_is_that_of_opencv_inside_and_black_outside(pinhole, fixed_point):
    view = named_view(pinhole, ViewOptions(size=(500, 400), fov=80.0))
    made = rectification_map(pinhole, view)
    picture = gradient_picture((640, 400))
    out = sampler(made, (640, 400), fixed_point=fixed_point)(picture)
    truth = cv2.remap(picture, np.ascontiguousarray(made.uv), None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    inner = made.valid & ((made.uv > 2) & (made.uv < [637, 397])).all(axis=2)
    assert np.abs(out.astype(int) - truth)[inner].max() <= 1
    np.testing.assert_array_equal((out > 0).all(axis=2), made.valid)
    np.testing.assert_array_equal((out > 0).any(axis=2), made.valid)


def test_the_outermost_pixels_of_the_image_are_shown_in_their_own_colour():
    camera = camera_of(Fisheye((320, 200), 100.0, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0)))
    view = named_view(camera, ViewOptions("equirectangular", size=(400, 300)))
    made = rectification_map(camera, view)
    near = made.valid & ((made.uv < 0.4) | (made.uv > np.array([319, 199]) - 0.4)).any(axis=2)
    assert near.sum() > 100
    out = remap(np.full((200, 320), 180, np.uint8), made)
    np.testing.assert_array_equal(out, np.where(made.valid, 180, 0))
    picture = gradient_picture((320, 200))
    nearest = cv2.remap(picture, np.ascontiguousarray(made.uv), None, cv2.INTER_NEAREST)
    assert np.abs(remap(picture, made).astype(int) - nearest)[near].max() <= 2


@pytest.mark.parametrize("shape", [(400, 640), (400, 640, 1), (400, 640, 3)])
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, np.float64, np.int32])
def test_every_kind_of_image_keeps_its_kind(pinhole, shape, dtype):
    view = named_view(pinhole, ViewOptions(size=(100, 80), fov=50.0))
    out = remap(np.full(shape, 77, dtype=dtype), rectification_map(pinhole, view))
    assert out.dtype == dtype
    assert out.shape == (80, 100, *shape[2:])
    assert (out > 0).mean() > 0.5
    np.testing.assert_allclose(out[out > 0], 77, rtol=1e-6 if np.issubdtype(dtype, np.floating) else 0)
