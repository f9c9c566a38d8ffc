"""
All boards together, with correct error bars
============================================

With four or more boards, all of them determine the map, in one solve. Every result has
a standard deviation. Here the noise of the corners and the camera are known, so the
error bars can be compared with the actual errors.
"""

import matplotlib.pyplot as plt
import numpy as np

import pinholify
from pinholify.simulation.lenses import BrownConrady
from pinholify.simulation.views import board_poses, true_corners, virtual_camera

NOISE = 0.1  # px

lens = BrownConrady((640, 480), (420.0, 420.0), (6.0, -4.0), (-0.18, 0.03, 0.0))
board = pinholify.Checkerboard(9, 6)
poses = board_poses((lens,), board, 8, seed=3)
truth = np.array(virtual_camera(poses[0]))


def calibrated(seed):
    """A camera from corners with independent noise."""
    rng = np.random.default_rng(seed)
    views = []
    for i, pose in enumerate(poses):
        uv = true_corners(lens, board, pose)
        noise = rng.normal(0.0, NOISE, uv.shape)
        views.append(pinholify.Corners(f"view-{i}", np.arange(len(uv)), uv + noise))
    corners = pinholify.CornerSet(board, lens.size, tuple(views))
    return pinholify.calibrate(corners, reference="view-0", trend="plane:2")


calibrations = [calibrated(seed) for seed in range(8)]

# %%
# Focal length and principal point
# --------------------------------
#
# In squares of the reference board: f is the distance from it, (uc, vc) the foot of the
# perpendicular on it.

found = np.array(
    [[k.f, k.uc, k.vc] for k in (c.camera.intrinsics for c in calibrations)]
)
stds = np.array([c.intrinsics_std for c in calibrations])

figure, axes = plt.subplots(1, 3, figsize=(10, 2.8), layout="constrained")
for axis, name, values, std, true in zip(
    axes, ("f", "uc", "vc"), found.T, stds.T, truth, strict=True
):
    axis.errorbar(np.arange(len(values)), values - true, std, fmt="o", capsize=3)
    axis.axhline(0.0, color="gray", linewidth=1)
    axis.set(title=f"{name}: error, squares", xlabel="noise realisation")

deviations = (found - truth) / stds
rms, largest = np.sqrt(np.mean(deviations**2)), np.abs(deviations).max()
print(f"errors in standard deviations: {rms:.2f} RMS, {largest:.1f} largest")
assert largest < 4.0

# %%
# Rays
# ----
#
# The error of a pixel's ray, and its predicted standard deviation. The frame of a
# camera is that of its reference board, whose pose is estimated in each realisation,
# so its uncertainty contributes to both.

pixels = np.stack(
    np.meshgrid(np.linspace(40, 600, 15), np.linspace(40, 440, 11)), axis=-1
).reshape(-1, 2)
directions = (
    lens.unproject(pixels).directions @ poses[0].rotation
)  # in the reference board's frame
errors, predictions = [], []
for calibration in calibrations:
    camera = calibration.camera
    errors.append(camera.project(directions) - pixels)
    predictions.append(camera.to_rays(pixels).std_px)
measured = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
predicted = np.sqrt(np.mean(np.square(predictions), axis=0))

figure, axis = plt.subplots(figsize=(4.6, 4.2), layout="constrained")
axis.loglog(predicted, measured, ".")
ends = [predicted.min(), predicted.max()]
axis.plot(ends, ends, color="gray", linewidth=1)
axis.set(
    xlabel="predicted standard deviation, px",
    ylabel="RMS error over the realisations, px",
    aspect="equal",
)

ratio = np.sqrt(np.mean(measured**2) / np.mean(predicted**2))
print(f"errors are {ratio:.2f} times the predicted standard deviations")
assert 0.5 < ratio < 2.0

# %%
# The noise is one number, in px of the image. Its true value is 0.1:

noise = np.array([c.camera.noise_px for c in calibrations])
print(f"estimated noise: {noise.mean():.3f} ± {noise.std():.3f} px")
assert abs(noise.mean() - NOISE) < 0.01
