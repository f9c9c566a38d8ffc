"""
A fisheye behind a windscreen
=============================

A windscreen deflects rays by a few px, differently everywhere. No lens formula
describes that; a process learns it from the corners. The same corners are used for
OpenCV's fisheye model and for ours.
"""

import cv2
import matplotlib.pyplot as plt
import numpy as np

import pinholify
from pinholify.evaluation.baseline import BoardPoints, fit_opencv
from pinholify.simulation.lenses import Fisheye, bumpy
from pinholify.simulation.views import board_poses, true_corners

fisheye = Fisheye((640, 480), 300.0, (0.03, -0.01, 0.0, 0.0), (5.0, -3.0))
lens = bumpy(fisheye, count=10, width=80.0, shift=4.0, seed=8)
board = pinholify.Checkerboard(15, 9)
poses = board_poses((lens,), board, 12, seed=5)

rng = np.random.default_rng(0)
views = []
for i, pose in enumerate(poses):
    uv = true_corners(lens, board, pose)
    noise = rng.normal(0.0, 0.1, uv.shape)
    views.append(pinholify.Corners(f"view-{i}", np.arange(len(uv)), uv + noise))
corners = pinholify.CornerSet(board, lens.size, tuple(views))

# %%
# Calibrate
# ---------

calibration = pinholify.calibrate(corners, reference="view-0")
print(f"trend {calibration.trend}, noise {calibration.camera.noise_px:.3f} px")

boards = [BoardPoints(view.lattice(board), view.uv) for view in views]
opencv = fit_opencv("fisheye", boards, lens.size)

# %%
# Where are the errors?
# ---------------------
#
# Each camera gives a direction for each pixel. Rotate these directions to fit the true
# ones as closely as possible, and project them with the true lens: the distance from
# the original pixel is the camera's error.

u, v = np.meshgrid(np.linspace(0, 639, 48), np.linspace(0, 479, 36))
pixels = np.column_stack([u.ravel(), v.ravel()])
true = lens.unproject(pixels).directions


def errors(found):
    """Errors (n,) in px of directions ``found`` (n, 3) of the grid's pixels."""
    left, _, right = np.linalg.svd(true.T @ found)  # Kabsch's method
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return np.linalg.norm(lens.project(found @ turn.T) - pixels, axis=1)


ours = errors(calibration.camera.to_rays(pixels).directions)
flat = cv2.fisheye.undistortPoints(pixels[:, None], opencv.matrix, opencv.distortion)
flat = flat.reshape(-1, 2)
directions = np.column_stack([flat, np.ones(len(flat))])
theirs = errors(directions / np.linalg.norm(directions, axis=1, keepdims=True))

figure, axes = plt.subplots(1, 2, figsize=(10, 3.9), layout="constrained", sharey=True)
named = {"OpenCV's fisheye model": theirs, "pinholify": ours}
for axis, (title, error) in zip(axes, named.items(), strict=True):
    size = error.reshape(u.shape)
    drawn = axis.pcolormesh(
        u, v, size, norm="log", vmin=0.01, vmax=10.0, shading="nearest"
    )
    axis.set(title=title, aspect="equal", ylim=(479, 0))
figure.colorbar(drawn, ax=axes, label="error, px", extend="both")

inside = calibration.camera.inside(pixels)
rms = {name: np.sqrt(np.mean(error[inside] ** 2)) for name, error in named.items()}
print(*(f"{name}: {error:.3f} px RMS" for name, error in rms.items()), sep="\n")
assert rms["pinholify"] < rms["OpenCV's fisheye model"] / 10
