"""A live camera, straightened frame by frame."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from pinholify.errors import ImageError
from pinholify.io.images import Image
from pinholify.rectification.straightener import Straightener


def straight_frames(source: int | str, straightener: Straightener) -> Iterator[Image]:
    """Yield the straightened frames (height, width, 3) uint8 BGR of the camera ``source`` until it delivers no more.

    ``source`` is anything that ``cv2.VideoCapture`` opens: a number, the URL of a stream, a device. The calibrated
    image size is requested from the camera; raises ImageError if the camera cannot be opened or delivers another size.
    Displaying frames is up to the caller: the headless OpenCV that pinholify depends on opens no windows. For video
    files use :func:`pinholify.straighten_video`, which keeps frame times, sound and bit depth.
    """
    capture = cv2.VideoCapture(source)
    try:
        if not capture.isOpened():
            raise ImageError(f"no camera answers at '{source}'; check its number, and that no other program uses it")
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, straightener.camera.image_size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, straightener.camera.image_size[1])
        while True:
            there, image = capture.read()
            if not there:
                return
            yield straightener(np.asarray(image))
    finally:
        capture.release()
