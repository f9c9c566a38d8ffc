"""A clip of a board that somebody moves before a camera, as Chromium's fake camera takes it (YUV4MPEG2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pinholify.simulation.photograph import photograph
from pinholify.simulation.rendering import pixel_rays, render
from pinholify.simulation.scene import CheckerboardTexture, Scene, TexturedPlane, cloudy
from pinholify.simulation.views import board_poses
from small_camera import BOARD, LENS, SIZE, SMALL

RATE = 5  # frames a second
HELD = 5  # frames for which a board is held still


def write_clip(path: Path, boards: int, *, seed: int = 5) -> None:
    """``boards`` boards, each held still for a second."""
    width, height = SIZE
    rays = pixel_rays(LENS)
    with open(path, "wb") as file:
        file.write(f"YUV4MPEG2 W{width} H{height} F{RATE}:1 Ip A1:1 C420jpeg\n".encode())
        for number, pose in enumerate(board_poses((LENS,), BOARD, boards, seed=seed, tilt=40.0)):
            scene = Scene((TexturedPlane(pose, CheckerboardTexture(BOARD)),), cloudy(0.5))
            picture = photograph(render(rays, scene, samples=13), SMALL.sensor, (seed, number))
            frame = b"FRAME\n" + picture.tobytes() + np.full(width * height // 2, 128, np.uint8).tobytes()
            file.write(frame * HELD)


def true_focal_px() -> float:
    """Focal length of the lens in the middle of the image: px per radian, the mean of all directions."""
    middle = (np.array(SIZE) - 1.0) / 2.0
    step = 0.5
    ends = middle + step * np.array([[-1.0, 0], [1, 0], [0, -1], [0, 1]])
    left, right, up, down = LENS.unproject(ends).directions
    turning = np.stack([right - left, down - up], axis=1) / (2 * step)
    return float(1.0 / np.sqrt(np.prod(np.linalg.svd(turning, compute_uv=False))))
