"""Inspecting a picture: its blur is measured, its board is detected, its previews are written."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pinholify.board import Checkerboard
from pinholify.io.images import read_image
from pinholify.web.inspection import blur, inspect_image, reduced, write_previews


@pytest.mark.parametrize("added", [0.0, 1.5, 3.0])
def test_blur_is_measured_in_px(photographs, added):
    sharp = read_image(photographs[1])
    corners = inspect_image(sharp, "a", Checkerboard(9, 6), False).corners
    image = cv2.GaussianBlur(sharp, (0, 0), added) if added else sharp
    expected = np.hypot(blur(sharp, corners), added)
    assert 0.6 < blur(sharp, corners) < 1.2  # the small camera's own is 0.7 px, and a pixel's width
    assert blur(image, corners) == pytest.approx(expected, rel=0.2)


def test_the_board_is_detected_unless_it_is_given(photographs):
    image = read_image(photographs[1])
    assert inspect_image(image, "a", None, False).board == Checkerboard(9, 6)
    other = inspect_image(image, "a", Checkerboard(12, 9), False)
    assert not other.corners.found
    assert other.suggestion == "9x6"
    assert inspect_image(np.zeros((100, 100), np.uint8), "a", None, False).board is None


def test_previews_have_eight_bits_and_keep_their_shape(tmp_path):
    image = (np.random.default_rng(0).random((300, 2000)) * 65535).astype(np.uint16)
    write_previews(image, tmp_path / "pages")
    view, thumb = (read_image(tmp_path / "pages" / f"{name}.jpg") for name in ("view", "thumb"))
    assert view.dtype == thumb.dtype == np.uint8
    assert view.shape[:2] == (240, 1600)
    assert thumb.shape[:2] == (72, 480)
    assert reduced(view, 5000) is view
