"""Code for using the camera file of a report."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Snippet:
    """Code to copy, with a ``title``, in a ``language`` (python, sh)."""

    title: str
    language: str
    text: str


PYTHON = """\
import pinholify

camera = pinholify.read_camera({file}).camera

straighten = pinholify.Straightener(camera)  # builds its map for the first picture and keeps it
straight = straighten(pinholify.read_image("photo.jpg"))
pinholify.write_image("straight.png", straight)
pinhole = straighten.view.matrix  # K (3, 3) px of the straight picture; no distortion
"""

RAYS = """\
import numpy as np
import pinholify

camera = pinholify.read_camera({file}).camera
pixels = np.array([{centre}, [0.0, 0.0]])  # (n, 2); integers are pixel centres

rays = camera.to_rays(pixels)
rays.directions  # (n, 3) unit vectors in the reference board's frame
rays.std_px  # (n,) standard deviation of each, px
camera.project(rays.directions)  # back to pixels, (n, 2)
"""

OPENCV = """\
import cv2
import pinholify

camera = pinholify.read_camera({file}).camera
view = pinholify.named_view(camera)
uv = pinholify.rectification_map(camera, view).uv

straight = cv2.remap(cv2.imread("photo.jpg"), uv, None, cv2.INTER_CUBIC)
matrix, distortion = view.matrix, None  # of the straight picture, for cv2.solvePnP etc.
"""

SHELL = """\
pinholify undistort {file} photos/ -o straight/
pinholify map {file} --to rays points.csv -o rays.csv
pinholify export {file} --format ros -o camera_info.yaml
pinholify export {file} --format colmap -o cameras.txt
pinholify evaluate {file} new-photos/
"""


def snippets(file: str, image_size: tuple[int, int]) -> tuple[Snippet, ...]:
    """Code for using the camera file called ``file``."""
    width, height = image_size
    centre = f"[{(width - 1) / 2}, {(height - 1) / 2}]"
    literal = json.dumps(file, ensure_ascii=False)
    word = shlex.quote(f"./{file}" if file.startswith("-") else file)
    return (
        Snippet("Straighten photographs", "python", PYTHON.format(file=literal)),
        Snippet("Pixels to rays, with error bars", "python", RAYS.format(file=literal, centre=centre)),
        Snippet("With OpenCV", "python", OPENCV.format(file=literal)),
        Snippet("On the command line", "sh", SHELL.format(file=word)),
    )
