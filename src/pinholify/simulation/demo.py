"""The images of ``pinholify demo``: boards and a street through a lens that no standard model fits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pinholify.board import Checkerboard
from pinholify.geometry import Pose
from pinholify.simulation.artwork import facade, pavement, sky
from pinholify.simulation.datasets import Dataset
from pinholify.simulation.lenses import Fisheye, Lens, bumpy
from pinholify.simulation.photograph import Sensor, photograph
from pinholify.simulation.rendering import pixel_rays, render
from pinholify.simulation.scene import Picture, Scene, TexturedPlane

_FISHEYE = Fisheye((1280, 960), 600.0, (0.03, -0.01, 0.0, 0.0), (9.0, -6.0))
_LENS = bumpy(_FISHEYE, count=16, width=140.0, shift=12.0, seed=8)

DEMO = Dataset(
    "demo",
    "A fisheye lens behind a bumpy windscreen",
    _LENS,
    Checkerboard(15, 9),
    12,
    Sensor(blur=0.8, vignetting=0.2, shot_noise=3.0, read_noise=1.5, jpeg_quality=92),
    12,
    {
        "lens": "122 degrees across, with visible bumps of up to 12 px that no lens model describes",
        "blur": "0.8 px: a sharp lens, and demosaicing",
        "vignetting": "a fifth of the light in the corners, so that the picture looks like a photograph",
        "noise": "that of a good camera in daylight",
        "jpeg": "quality 92: a camera's usual setting",
    },
)
"""Twelve photographs of a 15x9 checkerboard, the first filling the frame."""


def street(lens: Lens = DEMO.lens, sensor: Sensor = DEMO.sensor) -> NDArray[np.uint8]:
    """A photograph (h, w, 3) uint8, RGB, of a house front and its pavement through ``lens``: straight lines."""
    upright, lying = np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    width, per_metre = 28, 96
    front = Picture(facade(width, per_metre), per_metre)
    scene = Scene(
        (
            TexturedPlane(Pose(upright, np.array([-width / 2, -7.2, 7.0])), front),
            TexturedPlane(Pose(lying, np.array([0.5, 2.8, 7.0])), pavement),
        ),
        sky,
    )
    return photograph(render(pixel_rays(lens), scene, samples=7), sensor, DEMO.seed)
