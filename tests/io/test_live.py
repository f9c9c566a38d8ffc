"""A live camera: here a file of single pictures that OpenCV plays as one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pinholify import straight_frames
from pinholify.errors import ImageError
from pinholify.modes import scaled
from pinholify.rectification.straightener import Straightener
from small_camera import quick_camera

SIZE = (96, 72)


@pytest.fixture(scope="module")
def straightener():
    return Straightener(scaled(quick_camera(), SIZE))


def play(path, size):
    images = [np.full((*size[::-1], 3), 40 * i + 20, dtype=np.uint8) for i in range(4)]
    for i, image in enumerate(images):
        cv2.imwrite(str(path / f"{i:03d}.png"), image)
    return images, str(path / "%03d.png")


def test_every_frame_is_straightened(straightener, tmp_path):
    images, source = play(tmp_path, SIZE)
    found = list(straight_frames(source, straightener))
    assert len(found) == 4
    for image, frame in zip(images, found, strict=True):
        np.testing.assert_array_equal(frame, straightener(image))


def test_cameras_that_do_not_fit(straightener, tmp_path):
    _, source = play(tmp_path, (64, 48))
    with pytest.raises(ImageError, match="the image is 64x48 and the camera was calibrated at 96x72"):
        next(straight_frames(source, straightener))
    with pytest.raises(ImageError, match="no camera answers at"):
        next(straight_frames(str(tmp_path / "none.avi"), straightener))
