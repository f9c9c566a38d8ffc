"""
A fisheye behind a windscreen
=============================

A windscreen bends rays by a few px, differently everywhere. Lens formulas have no words for that; a process learns it
from the corners. The same corners go into OpenCV's fisheye model and into ours.
"""

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
    views.append(pinholify.Corners(f"view-{i}", np.arange(len(uv)), uv + rng.normal(0.0, 0.1, uv.shape)))
corners = pinholify.CornerSet(board, lens.size, tuple(views))

# %%
# Calibrate
# ---------

calibration = pinholify.calibrate(corners, reference="view-0")
print(f"trend {calibration.trend}, noise {calibration.camera.noise_px:.3f} px")

opencv = fit_opencv("fisheye", [BoardPoints(view.lattice(board), view.uv) for view in views], lens.size)
residual = np.concatenate([opencv.residuals(BoardPoints(view.lattice(board), view.uv)) for view in views])
print(f"OpenCV's fisheye model leaves {np.sqrt((residual**2).sum(axis=1).mean()):.2f} px")

# %%
# Where is it wrong?
# ------------------
#
# On a grid of pixels: where each camera sees the point that the true lens sees, less that pixel, after the rotation
# that brings both as close together as can be.

u, v = np.meshgrid(np.linspace(0, 639, 48), np.linspace(0, 479, 36))
pixels = np.column_stack([u.ravel(), v.ravel()])
true = lens.unproject(pixels).directions


def best_rotation(found):
    """The rotation that takes true directions nearest to ``found`` ones (n, 3), by Kabsch's method."""
    known = np.isfinite(found).all(axis=1)
    left, _, right = np.linalg.svd(found[known].T @ true[known])
    return left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right


camera = calibration.camera
ours = camera.project(true @ best_rotation(camera.to_rays(pixels).directions).T) - pixels
theirs = fisheye.project(true) - pixels  # even the true fisheye, without its windscreen, is this far off

figure, axes = plt.subplots(1, 2, figsize=(10, 3.9), layout="constrained", sharey=True)
for axis, error, title in zip(axes, (theirs, ours), ("the lens without its windscreen", "pinholify"), strict=True):
    size = np.linalg.norm(error, axis=1).reshape(u.shape)
    drawn = axis.pcolormesh(u, v, size, norm="log", vmin=0.01, vmax=5.0, shading="nearest")
    axis.set(title=title, aspect="equal", ylim=(479, 0))
figure.colorbar(drawn, ax=axes, label="error, px", extend="both")

inside = camera.inside(pixels)
rms = np.sqrt(np.nanmean((ours[inside] ** 2).sum(axis=1)))
bumps = np.sqrt(np.mean((theirs[inside] ** 2).sum(axis=1)))
print(f"bumps of {bumps:.2f} px rms, of which {rms:.3f} px are left")
assert rms < bumps / 10
