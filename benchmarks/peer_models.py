"""OpenCV's and lensboy's models, for ``peers.py``: run with the Python that has them.

    python peer_models.py FOLDER CASE MODEL RAYS.csv

reads CASE.npz from FOLDER, and writes the rays of its pixels. MODEL: opencv8, fisheye, or lensboy:16x10, the numbers of
knots.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

ITERATIONS = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
FLAGS = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2  # OpenCV 5 has them elsewhere


def lensboy(board, corners, size, pixels, knots):
    import lensboy

    across, down = map(int, knots.split("x"))
    frames = [lensboy.Frame(np.arange(len(board)), view) for view in corners]
    config = lensboy.PinholeSplinedConfig(
        image_width=size[0], image_height=size[1], num_knots_x=across, num_knots_y=down
    )
    return lensboy.calibrate_camera(board, frames, camera_model_config=config).camera_model.normalize_points(pixels)


def fisheye(board, corners, size, pixels):
    points = [board[None].astype(np.float64)] * len(corners)
    k, distortion = np.eye(3), np.zeros(4)
    seen = [view[None] for view in corners]
    flags = FLAGS.CALIB_RECOMPUTE_EXTRINSIC | FLAGS.CALIB_FIX_SKEW
    cv2.fisheye.calibrate(points, seen, size, k, distortion, flags=flags)
    return cv2.fisheye.undistortPoints(pixels[:, None], k, distortion)[:, 0]


def rational(board, corners, size, pixels):
    points, seen = [board.astype(np.float32)] * len(corners), [view[:, None].astype(np.float32) for view in corners]
    _, k, distortion, *_ = cv2.calibrateCamera(points, seen, size, None, None, flags=cv2.CALIB_RATIONAL_MODEL)
    invert, unused = (cv2.undistortPoints, 3) if cv2.__version__ >= "5" else (cv2.undistortPointsIter, 2)
    return invert(pixels[:, None], k, distortion, *[None] * unused, ITERATIONS)[:, 0]


folder, name, model, out = sys.argv[1:]
case = np.load(Path(folder, f"{name}.npz"))
columns, rows = case["board"]
x, y = np.meshgrid(np.arange(columns), np.arange(rows))
lattice = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).astype(np.float64)
program, _, option = model.partition(":")
find = {"lensboy": lensboy, "fisheye": fisheye, "opencv8": rational}[program]
rays = find(lattice, case["noisy"], tuple(map(int, case["size"])), case["px"], *([option] if option else []))
if rays.shape[1] == 2:
    rays = np.column_stack([rays, np.ones(len(rays))])
np.savetxt(out, rays, delimiter=",", header="x,y,z", comments="")
