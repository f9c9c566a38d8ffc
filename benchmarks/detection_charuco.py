"""ChArUco versions of the rendered scenes: the same lenses, poses and occluder, rendered by our own simulator.

    python benchmarks/detection_charuco.py SCENES.py FOLDER FIRST_SEED COUNT
    python benchmarks/detection.py scenes SCENES.py FOLDER --board charuco:16x10:DICT_4X4_100:0.7

SCENES.py is the renderer of plain boards that stands beside the project's shared data.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from detection import scorer_of
from pinholify.board import parse_board
from pinholify.geometry import Pose
from pinholify.io.board_print import ARTWORKS
from pinholify.simulation.lenses import BrownConrady, Fisheye
from pinholify.simulation.photograph import Sensor, photograph
from pinholify.simulation.rendering import pixel_rays, render
from pinholify.simulation.scene import Picture, Scene, TexturedPlane
from pinholify.simulation.views import true_corners

BOARD = parse_board("charuco:16x10:DICT_4X4_100:0.7")
CELLS = 60  # pixels a square of the printed picture: six cells of a marker are 42 of them
DARK, LIGHT, BACKGROUND, OCCLUDER = 20 / 255, 235 / 255, 110 / 255, 90
SENSOR = Sensor(blur=0.7, read_noise=3.0)
SAMPLES = 13  # rays a pixel


def printed() -> Picture:
    """The board as it is printed, with a light margin of half a square."""
    artwork = ARTWORKS[type(BOARD)](BOARD)
    border = CELLS // 2
    shape = [round(CELLS * n) + 2 * border for n in (artwork.rows, artwork.columns)]
    pixels = np.full([*shape, 1], LIGHT, np.float32)
    for r in artwork.black:
        x0, y0, x1, y1 = (border + round(CELLS * v) for v in (r.x, r.y, r.x + r.width, r.y + r.height))
        pixels[y0:y1, x0:x1] = DARK
    start = (0.5 - border) / CELLS
    return Picture(pixels, CELLS, (start - artwork.origin[0], start - artwork.origin[1]))


def lens_of(camera, size):
    offset = tuple(camera.centre - (np.array(size) - 1) / 2)
    if camera.fisheye:
        return Fisheye(size, camera.focal, (camera.k, 0.0, 0.0, 0.0), offset)
    return BrownConrady(size, (camera.focal, camera.focal), offset, (camera.k, 0.0, 0.0))


def make(scenes, folder: Path, first: int, count: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    size, texture = (scenes.W, scenes.H), printed()
    for number, kind in enumerate(scenes.KINDS):
        lens = lens_of(scenes.KINDS[kind][0], size)
        rays = pixel_rays(lens)
        for seed in range(first, first + count):
            pose = Pose(*scenes.pose(kind, np.random.default_rng([seed, number])))
            scene = Scene((TexturedPlane(pose, texture),), lambda directions: np.full((len(directions), 1), BACKGROUND))
            image = photograph(render(rays, scene, samples=SAMPLES), SENSOR, (seed, number))
            uv = np.nan_to_num(true_corners(lens, BOARD, pose), nan=-1e6)  # what the lens does not see
            visible = (uv > 6).all(axis=1) & (uv < np.array(size) - 7).all(axis=1)
            if kind == "occluded":
                centre, radius = scenes.OCCLUDER
                cv2.circle(image, centre, radius, OCCLUDER, -1)
                visible &= np.linalg.norm(uv - centre, axis=1) > radius + 8
            cv2.imwrite(str(folder / f"{kind}-{seed}.png"), image)
            np.savez(folder / f"{kind}-{seed}.npz", uv=uv, visible=visible)


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    make(scorer_of(Path(sys.argv[1])), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
