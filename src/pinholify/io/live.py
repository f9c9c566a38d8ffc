"""A live camera, straightened frame by frame, for programs that look at it."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from pinholify.errors import ImageError
from pinholify.io.images import Image
from pinholify.rectification.straightener import Straightener


def straight_frames(source: int | str, straightener: Straightener) -> Iterator[Image]:
    """The straightened frames (height, width, 3) uint8, BGR, of the camera number ``source`` until it gives no more.

    ``source`` may be whatever ``cv2.VideoCapture`` opens: a number, a stream's URL, a device. The camera is asked for
    images of the calibrated size; ImageError where it does not open or gives another size. Show them in a window of
    your own (the headless OpenCV that pinholify needs opens none), write them on, or feed them to a network. For video
    files :func:`pinholify.straighten_video` keeps times, sound and depth, which this does not.
    """
    capture = cv2.VideoCapture(source)
    try:
        if not capture.isOpened():
            raise ImageError(f"no camera answers at '{source}'; check its number and that no other program uses it")
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, straightener.camera.image_size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, straightener.camera.image_size[1])
        while True:
            there, image = capture.read()
            if not there:
                return
            yield straightener(np.asarray(image))
    finally:
        capture.release()
