"""Frames remapped plane by plane: nothing is lost where the map changes nothing, and colour stays where it belongs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pinholify.rectification.maps import RectificationMap
from pinholify.rectification.views import View
from videos import frame_of, plane

av = pytest.importorskip("av", reason="needs the extra 'video'")

from pinholify.io.video.planes import can_be_remapped, frame_straightener, plane_kinds  # noqa: E402

FORMATS = [
    "yuv420p", "yuvj420p", "yuv422p", "yuv444p", "yuv410p", "gray", "gbrp",
    "yuv420p10le", "yuv422p10le", "yuv444p12le", "gray16le", "gbrp10le",
]  # fmt: skip


def affine_map(size, scale=1.0, shift=(0.0, 0.0)):
    """The map of a view of ``size`` whose pixel p shows pixel ``scale`` · p + ``shift``."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    uv = np.stack([scale * x + shift[0], scale * y + shift[1]], axis=-1).astype(np.float32)
    return RectificationMap(View(np.eye(3), np.eye(3), size), uv, np.ones(size[::-1], dtype=bool))


@pytest.mark.parametrize("pixel_format", FORMATS)
@pytest.mark.parametrize("size", [(48, 36), (47, 35)])
def test_a_map_that_changes_nothing_changes_no_sample(pixel_format, size):
    frame = frame_of(3, size, pixel_format)
    frame.pts, frame.colorspace = 7, 1
    out = frame_straightener(affine_map(size), size, pixel_format, full_range=False)(frame)
    assert (out.pts, int(out.colorspace), out.format.name) == (7, 1, pixel_format)
    for i in range(len(frame.planes)):
        np.testing.assert_array_equal(plane(out, i), plane(frame, i))


@pytest.mark.parametrize(("pixel_format", "step"), [("yuv420p10le", (2, 2)), ("yuv422p10le", (2, 1))])
def test_colour_lies_beside_the_left_and_between_the_rows_of_its_pixels(pixel_format, step):
    size, slope = (64, 48), 12
    frame = frame_of(0, size, pixel_format)
    u = slope * step[0] * np.arange(64 // step[0]) + np.zeros((48 // step[1], 1))
    v = slope * (step[1] * np.arange(48 // step[1]) + (step[1] - 1) / 2)[:, None] + np.zeros(64 // step[0])
    for number, values in ((1, u), (2, v)):
        p = frame.planes[number]
        np.frombuffer(p, np.uint16).reshape(p.height, -1)[:, : p.width] = 100 + values
    out = frame_straightener(affine_map(size, 0.5, (9, 7)), size, pixel_format, full_range=False)(frame)
    x, y = np.meshgrid(step[0] * np.arange(64 // step[0]), step[1] * np.arange(48 // step[1]) + (step[1] - 1) / 2)
    inner = np.s_[4:-4, 4:-4]
    assert np.abs(plane(out, 1) - (100 + slope * (0.5 * x + 9)))[inner].max() < 1.3
    assert np.abs(plane(out, 2) - (100 + slope * (0.5 * y + 7)))[inner].max() < 1.3


@pytest.mark.parametrize(
    ("pixel_format", "full", "black"),
    [
        ("yuv420p", False, (16, 128, 128)),
        ("yuv420p", True, (0, 128, 128)),
        ("yuv420p10le", False, (64, 512, 512)),
        ("gray", False, (16,)),
        ("gbrp", False, (0, 0, 0)),
    ],
)
def test_what_is_not_known_is_black(pixel_format, full, black):
    size = (32, 24)
    rectification = affine_map(size)
    rectification.valid[:, 16:] = False
    rectification.uv[:, 24:] = np.nan
    out = frame_straightener(rectification, size, pixel_format, full_range=full)(frame_of(0, size, pixel_format))
    for i, value in enumerate(black):
        samples = plane(out, i)
        assert (samples[:, samples.shape[1] // 2 :] == value).all()
        assert (samples[:, : samples.shape[1] // 2] != value).any()


def test_cubic_overshoot_stays_within_ten_bits():
    size = (64, 48)
    frame = frame_of(0, size, "gray10le")
    steps = np.where(np.random.default_rng(0).random((48, 64)) < 0.5, 0, 1023)
    np.frombuffer(frame.planes[0], np.uint16).reshape(48, -1)[:, :64] = steps
    out = frame_straightener(affine_map(size, 1.0, (0.5, 0.5)), size, "gray10le", full_range=True)(frame)
    assert plane(out, 0).max() == 1023
    assert plane(out, 0).min() == 0


def test_fixed_point_maps_do_for_video():
    """On a smooth pattern 1/32 px is worth less than a level of 8 bits against maps of float."""
    size = (96, 72)
    frame = frame_of(0, size, "yuv420p")
    rectification = affine_map(size, 0.93, (2.217, 3.391))
    out = frame_straightener(rectification, size, "yuv420p", full_range=False)(frame)
    exact = cv2.remap(plane(frame, 0).astype(np.float32), rectification.uv, None, cv2.INTER_CUBIC)
    assert np.abs(plane(out, 0) - exact).max() < 1.0


def test_formats_that_cannot_be_remapped_are_told():
    assert all(map(can_be_remapped, FORMATS))
    assert not any(map(can_be_remapped, ["nv12", "rgb24", "yuyv422", "pal8", "yuva420p", "gbrpf32le", "yuv420p10be"]))
    assert [k.subsampling for k in plane_kinds("yuv420p", full_range=False)] == [(1, 1), (2, 2), (2, 2)]
