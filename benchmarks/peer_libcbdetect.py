"""Corners by libcbdetect, for ``detection.py``: run with the Python that has it.

    python peer_libcbdetect.py < PATHS

PATHS are images, one a line, that its own OpenCV can read (BMP). Prints one JSON object a line: the seconds it took,
and of the first board it found the corners as rows of [u, v], null where one is missing.
"""

import json
import sys
import time

import numpy as np
from libCBDetect import Checkerboard


def detect(path):
    detector = Checkerboard()
    detector.show_processing = False
    start = time.perf_counter()
    detector.load_image(path)
    detector.find_corners()
    if detector.number_of_corners:
        detector.find_board_from_corners()
    seconds = time.perf_counter() - start
    if not detector.rows * detector.cols:
        return {"seconds": seconds, "board": []}
    u, v = np.zeros((detector.rows, detector.cols)), np.zeros((detector.rows, detector.cols))
    detector.get_board_corners(u, v)
    missing = ~((u > 0.5) & (v > 0.5) & (u < 1e5) & (v < 1e5))  # it says (0, -1) or so, or what was in memory
    rows = np.stack([u, v], axis=2).tolist()
    board = [[None if gone else uv for uv, gone in zip(*row, strict=True)] for row in zip(rows, missing, strict=True)]
    return {"seconds": seconds, "board": board}


for line in sys.stdin:
    print(json.dumps(detect(line.strip())), flush=True)
