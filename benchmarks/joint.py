"""The joint refinement against OpenCV's models on simulated lenses: same corners, one run, as ratios.

    python benchmarks/joint.py [LENS ...]      all central lenses of the simulation unless named
    python benchmarks/joint.py --scaling       time at 500 boards against 50

24 noisy boards (0.1 px an axis) calibrate, 12 others without noise are scored: only their poses are fitted, and what is
left is the camera's own error, as the root mean square of distances in px. "best" is the best of OpenCV's models, which
a user would have to know; nothing is chosen for ours. Times are of one process on one core.
"""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import sys
import time

import numpy as np

from pinholify.board import Checkerboard
from pinholify.corners import Corners, CornerSet
from pinholify.evaluation.baseline import MODELS
from pinholify.evaluation.heldout import Split, camera_residuals, heldout_rms, opencv_residuals
from pinholify.pipeline import calibrate
from pinholify.simulation.lenses import LENSES
from pinholify.simulation.views import board_poses, true_corners

BOARD = Checkerboard(12, 9)
TRAINING, TESTING = 24, 12
NOISE = 0.1


def scene(lens, count, seed=1):
    """True corners (count, n, 2) of boards in front of ``lens``."""
    return np.array([true_corners(lens, BOARD, pose) for pose in board_poses([lens], BOARD, count, seed=seed)])


def corner_set(lens, uv):
    ids = np.arange(uv.shape[1])
    return CornerSet(BOARD, lens.size, tuple(Corners(f"view{i:03d}", ids, view) for i, view in enumerate(uv)))


def timed(function, *arguments, **options):
    start = time.process_time()
    return function(*arguments, **options), time.process_time() - start


def score(name):
    lens = LENSES[name]
    true = scene(lens, TRAINING + TESTING)
    noisy = true[:TRAINING] + np.random.default_rng(0).normal(0.0, NOISE, true[:TRAINING].shape)
    corners = corner_set(lens, np.concatenate([noisy, true[TRAINING:]]))
    split = Split(corners.with_views(corners.views[:TRAINING]), corners.views[TRAINING:])
    ours, seconds = timed(calibrate, split.train, reference="view000", method="joint")
    joint = heldout_rms(camera_residuals(ours, BOARD), split.test)
    peers = {}
    for model in MODELS:
        residuals, peer_seconds = timed(opencv_residuals, model, split, BOARD)
        error = heldout_rms(residuals, split.test) if residuals is not None else None
        peers[model] = (np.inf if error is None else error, peer_seconds)
    best = min(peers, key=lambda model: peers[model][0])
    print(
        f"{name:20s} joint {joint:7.4f} px in {seconds:5.2f} s ({ours.trend}); best of OpenCV: {best} "
        f"{peers[best][0]:7.4f} px in {peers[best][1]:5.2f} s; ratio {joint / peers[best][0]:.3f}"
    )


def scaling():
    lens = LENSES["brown-conrady"]
    seconds = {}
    for count in (50, 500):
        uv = scene(lens, count)
        noisy = uv + np.random.default_rng(0).normal(0.0, NOISE, uv.shape)
        _, seconds[count] = timed(calibrate, corner_set(lens, noisy), reference="view000", method="joint")
    print(f"50 boards {seconds[50]:.2f} s, 500 boards {seconds[500]:.2f} s: ratio {seconds[500] / seconds[50]:.1f}")


if __name__ == "__main__":
    if "--scaling" in sys.argv:
        scaling()
    else:
        for chosen in sys.argv[1:] or [name for name, lens in LENSES.items() if lens.central]:
            score(chosen)
