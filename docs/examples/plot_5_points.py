"""
Points, without images
======================

Programs that work on points need no straightened image. The functions of
:mod:`pinholify.points` have the argument order and shapes of OpenCV's; a camera
replaces the matrix and the distortion coefficients.
"""

import matplotlib.pyplot as plt
import numpy as np

import pinholify
from pinholify.points import (
    distort_points,
    project_points,
    solve_pnp,
    undistort_points,
    undistortion_table,
)
from pinholify.simulation.lenses import Fisheye
from pinholify.simulation.views import board_poses, true_corners

lens = Fisheye((640, 480), 260.0, (0.02, -0.008, 0.0, 0.0), (3.0, -2.0))
board = pinholify.Checkerboard(9, 6)
poses = board_poses((lens,), board, 9, seed=1)
rng = np.random.default_rng(0)
views = []
for i, pose in enumerate(poses):
    uv = true_corners(lens, board, pose)
    noise = rng.normal(0.0, 0.05, uv.shape)
    views.append(pinholify.Corners(f"view-{i}", np.arange(len(uv)), uv + noise))
train = pinholify.CornerSet(board, lens.size, tuple(views[:8]))
calibration = pinholify.calibrate(train, reference="view-0", trend="angle:2")
camera = calibration.camera

# %%
# Convert pixels to ideal points, in px of any pinhole view, and back.

view = pinholify.named_view(camera)
ideal = undistort_points(views[8].uv, camera, R=view.rotation, P=view.matrix)
back = distort_points(undistort_points(views[8].uv, camera), camera)
assert np.allclose(back, views[8].uv, atol=1e-6)

figure, axes = plt.subplots(1, 2, figsize=(10, 3.9), layout="constrained")
for axis, points, title in zip(
    axes, (views[8].uv, ideal), ("in the photograph", "in the ideal view"), strict=True
):
    for line in points.reshape(board.rows, board.columns, 2):
        axis.plot(*line.T, ".-")
    axis.set(title=title, xlim=(0, 639), ylim=(479, 0), aspect="equal")

# %%
# A table for millions of points, accurate to a thousandth of a px of the image:

many = rng.uniform((0, 0), (639, 479), (50_000, 2))
many = many[camera.inside(many)]
table = undistortion_table(camera, view.rotation, view.matrix)
difference = np.abs(
    table(many)
    - undistort_points(many, camera, view.rotation, view.matrix, tolerance=0.0)
).max()
print(f"largest difference between table and formula: {difference:.4f} px of the view")
assert difference < 0.05

# %%
# The pose of the ninth board, which was not used in the calibration.

points = calibration.board_points[views[8].ids]
_, rvec, tvec = solve_pnp(points, views[8].uv, camera)
again, _ = project_points(points, rvec, tvec, camera)
rms = np.sqrt(np.mean((again - views[8].uv) ** 2))
print(f"{rms:.3f} px RMS per axis; the noise of the corners is 0.05 px")

# Both in the frame of the first board: the true position, and the estimated one.
true = poses[0].rotation.T @ poses[8].translation
found = tvec.ravel()
print(f"corner 0 of the board is at {found.round(3)}; the truth is {true.round(3)}")
assert np.linalg.norm(found - true) < 0.02 * np.linalg.norm(true)
