"""
Cameras without a centre
========================

Behind a flat pane under water a camera has no optical centre: rays are refracted at the
pane, and those of different pixels no longer meet in one point. No pinhole camera
reproduces its images exactly. This example shows the error as a function of the
camera's distance from the pane.
"""

import matplotlib.pyplot as plt
import numpy as np

import pinholify
from pinholify.simulation.lenses import Pinhole, WaterPane
from pinholify.simulation.views import board_poses, true_corners

board = pinholify.Checkerboard(9, 6)
NOISE = 0.1  # px per axis


def heldout_error(lens):
    """The error on boards that were not used in the calibration, px per point."""
    rng = np.random.default_rng(0)
    views = []
    for i, pose in enumerate(board_poses((lens,), board, 16, seed=4)):
        uv = true_corners(lens, board, pose)
        noise = rng.normal(0.0, NOISE, uv.shape)
        views.append(pinholify.Corners(f"view-{i}", np.arange(len(uv)), uv + noise))
    train = pinholify.CornerSet(board, lens.size, tuple(views[:10]))
    test = pinholify.CornerSet(board, lens.size, tuple(views[10:]))
    calibration = pinholify.calibrate(train, reference="view-0", trend="plane")
    return pinholify.evaluate(calibration, test, compare_opencv=False).heldout_px


camera = Pinhole((640, 480), 450.0)
distances = (0.05, 0.5, 2.0)
errors = [heldout_error(WaterPane(camera, distance, 0.1)) for distance in distances]
in_air = heldout_error(camera)

figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
axis.plot(distances, errors, "o-", label="behind water")
axis.axhline(in_air, color="gray", label="in air")
axis.set(
    xlabel="distance from the pane, squares", ylabel="held-out error, px per point"
)
axis.legend()

for distance, error in zip(distances, errors, strict=True):
    print(f"pane {distance:4.2f} squares away: {error:.3f} px")
print(f"in air: {in_air:.3f} px")
assert in_air < 1.7 * NOISE  # the noise alone gives √2
assert errors == sorted(errors)
