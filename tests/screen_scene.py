"""A small screen before a small camera, captured with noise: what the tests of Gray codes share."""

from __future__ import annotations

import numpy as np

from pinholify.board import Checkerboard, Screen
from pinholify.detection.gray_code import Sequence
from pinholify.geometry import Pose
from pinholify.simulation.lenses import BrownConrady
from pinholify.simulation.photograph import Sensor
from pinholify.simulation.views import board_poses
from simulated_screen import capture_screen

SIZE = (320, 240)
LENS = BrownConrady(SIZE, (210.0, 210.0), (3.0, -2.0), (-0.18, 0.03, 0.0))
SCREEN = Screen(320, 192, 16)
SEQUENCE = Sequence((320, 192), 8, 32, 0.25)
SENSOR = Sensor(blur=0.7, vignetting=0.2, shot_noise=2.0, read_noise=1.0)


def screen_poses(count: int) -> tuple[Pose, ...]:
    """Poses at which the whole lattice of nodes is seen, the first filling the frame."""
    poses = board_poses((LENS,), Checkerboard(11, 7), count, seed=4)
    scale = (SCREEN.columns - 1) / 10.0
    return tuple(Pose(pose.rotation, pose.translation * scale) for pose in poses)


def captures(pose: Pose, sequence: Sequence = SEQUENCE, sensor: Sensor = SENSOR, seed: int = 0) -> list[np.ndarray]:
    """The captures (240, 320) uint8 of all patterns."""
    pictures = (sequence.picture(pattern) for pattern in sequence.patterns)
    return list(capture_screen(LENS, pose, pictures, sensor, spacing=SCREEN.spacing, seed=seed))
