"""
Straight lines from one photograph
==================================

One photograph of a board that fills the frame determines the map of the image; two
more, of tilted boards, determine the focal length. This is the paper's method. The
camera here is a 122° fisheye behind a windscreen with bumps of several px, which no
lens formula describes.
"""

# sphinx_gallery_thumbnail_number = 2

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pinholify
from pinholify.simulation.datasets import reduced
from pinholify.simulation.demo import DEMO, street

# %%
# Photographs
# -----------
#
# They are rendered and written to files, as a camera would do.

scene = reduced(DEMO, 2.0)
board = scene.board
folder = Path(tempfile.mkdtemp())
photographs = list(scene.photographs(limit=3))
for photograph in photographs:
    pinholify.write_image(folder / f"{photograph.name}.png", photograph.image)

figure, axes = plt.subplots(1, 3, figsize=(10, 2.6), layout="constrained")
for axis, photograph in zip(axes, photographs, strict=True):
    axis.imshow(photograph.image, cmap="gray")
    axis.axis("off")

# %%
# Corners, and a camera
# ---------------------

corners = pinholify.detect_files(
    [str(path) for path in sorted(folder.iterdir())], board, workers=1
)
calibration = pinholify.calibrate(corners, method="one-image")
camera = calibration.camera
focal, std = camera.intrinsics.f, calibration.intrinsics_std[0]
print(f"from {calibration.reference}: f = {focal:.3f} ± {std:.3f} squares")

# %%
# A street, straightened
# ----------------------
#
# The part of the image outside the board is unknown, and remains black.

seen = street(scene.lens)
straight = pinholify.Straightener(camera)(seen)

figure, axes = plt.subplots(1, 2, figsize=(10, 3.9), layout="constrained")
for axis, picture, title in zip(
    axes, (seen, straight), ("as photographed", "straightened"), strict=True
):
    axis.imshow(picture)
    axis.set_title(title)
    axis.axis("off")

# %%
# Is it right?
# ------------
#
# Take points on straight lines in space that were not used in the calibration, project
# them with the true lens, and measure how far their virtual points are from a straight
# line, in px of the image.

z = 6.0
lines = [
    np.column_stack([np.linspace(-3, 3, 50), np.full(50, y), np.full(50, z)])
    for y in np.linspace(-2, 2, 9)
]
errors = []
for line in lines:
    pixels = scene.lens.project(line)
    pixels = pixels[camera.inside(pixels)]
    points = camera.virtual_points(pixels)
    across = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][1]
    per_pixel = np.sqrt(np.abs(np.linalg.det(camera.virtual_jacobian(pixels))))
    errors.append((points - points.mean(axis=0)) @ across / per_pixel)
error = np.sqrt(np.mean(np.concatenate(errors) ** 2))
print(f"distance from a straight line: {error:.3f} px RMS")
assert error < 0.5
