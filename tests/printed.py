"""Boards as they are printed, on planes of rendered scenes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.board import CircleGrid, outline
from pinholify.io.board_print import ARTWORKS, Disc
from pinholify.simulation.photograph import Sensor, photograph
from pinholify.simulation.rendering import pixel_rays, render
from pinholify.simulation.scene import Picture, Scene, TexturedPlane, cloudy
from pinholify.simulation.views import true_corners

DARK, LIGHT = 0.07, 0.9


@dataclass(frozen=True, slots=True)
class CircleGridTexture:
    """``board`` on a light sheet that ends ``margin`` units beyond the outermost centres; centre 0 is the origin."""

    board: CircleGrid
    margin: float = 1.0
    dark: float = 0.07
    light: float = 0.9

    def __call__(self, xy):
        """Colours (N, 1) of ``xy`` (N, 2)."""
        row = np.clip(np.rint(xy[:, 1]), 0, self.board.rows - 1).astype(np.int64)
        first, second = (self.board.places(np.full_like(row, column), row)[:, 0] for column in (0, 1))
        nearest = np.rint((xy[:, 0] - first) / (second - first))
        column = np.clip(nearest, 0, self.board.columns - 1).astype(np.int64)
        from_centre = np.linalg.norm(xy - self.board.places(column, row), axis=1)
        colour = np.where(from_centre < self.board.diameter / 2, self.dark, self.light)
        low, high = outline(self.board)
        on_sheet = ((xy >= low - self.margin) & (xy <= high + self.margin)).all(axis=1)
        return np.asarray(np.where(on_sheet, colour, np.nan)[:, None])


def printed(board, *, cells=100, margin=0.5):
    """The artwork of ``board`` as a picture whose lattice is the board's own; its edges fall between pixels.

    ``cells`` pixels a square: a multiple of what the artwork divides a square into. Circles are drawn exactly.
    """
    artwork = ARTWORKS[type(board)](board)
    if isinstance(artwork.black[0], Disc):
        return CircleGridTexture(board, margin=0.5 + margin, dark=DARK, light=LIGHT)
    border = round(margin * cells)
    pixels = np.full([round(cells * n) + 2 * border for n in (artwork.rows, artwork.columns)] + [1], LIGHT, np.float32)
    for r in artwork.black:
        x0, y0, x1, y1 = (border + round(cells * v) for v in (r.x, r.y, r.x + r.width, r.y + r.height))
        pixels[y0:y1, x0:x1] = DARK
    # Pixel 0's centre is half a pixel inside the sheet's corner.
    start = (0.5 - border) / cells
    return Picture(pixels, cells, (start - artwork.origin[0], start - artwork.origin[1]))


def take(lens, board, pose, *, sensor=None, seed=0, rays=None, texture=None):
    """A photograph of ``board`` at ``pose`` through ``lens`` and its true points (n, 2) px, by id."""
    scene = Scene((TexturedPlane(pose, texture or printed(board)),), cloudy(0.45, seed=seed))
    sensor = sensor or Sensor(blur=0.8, shot_noise=2.0, read_noise=1.5)
    image = photograph(render(rays or pixel_rays(lens), scene), sensor, seed)
    return image, true_corners(lens, board, pose)
