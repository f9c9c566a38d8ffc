"""Procedural textures full of straight lines: a house front, a pavement, a sky.

Lengths in metres. Colours are (red, green, blue), 0 … 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Floats

Colour = tuple[float, float, float]

_STONE: Colour = (0.83, 0.79, 0.70)
_LINE: Colour = (0.45, 0.42, 0.38)
_WHITE: Colour = (0.93, 0.93, 0.91)
_GLASS: Colour = (0.20, 0.29, 0.38)
_DOOR: Colour = (0.13, 0.30, 0.24)
_INK: Colour = (0.12, 0.16, 0.30)

_LETTERS = {
    "P": ("1111.", "1...1", "1...1", "1111.", "1....", "1....", "1...."),
    "I": ("111", ".1.", ".1.", ".1.", ".1.", ".1.", "111"),
    "N": ("1...1", "11..1", "1.1.1", "1..11", "1...1", "1...1", "1...1"),
    "H": ("1...1", "1...1", "1...1", "11111", "1...1", "1...1", "1...1"),
    "O": (".111.", "1...1", "1...1", "1...1", "1...1", "1...1", ".111."),
    "L": ("1....", "1....", "1....", "1....", "1....", "1....", "11111"),
    "E": ("11111", "1....", "1....", "1111.", "1....", "1....", "11111"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """``pixels`` (h, w, 3) float32 to paint on, at ``per_metre`` pixels per metre; (0, 0) is the top left."""

    pixels: NDArray[np.float32]
    per_metre: int

    def rectangle(self, x: float, y: float, width: float, height: float, colour: Colour) -> None:
        """Fill the rectangle with its top left at (x, y)."""
        left, right, top, bottom = (round(v * self.per_metre) for v in (x, x + width, y, y + height))
        self.pixels[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = colour

    def text(self, text: str, x: float, y: float, dot: float, colour: Colour) -> None:
        """Write ``text``, starting at (x, y), in letters made of square dots of size ``dot``."""
        for letter in text:
            rows = _LETTERS[letter]
            for j, row in enumerate(rows):
                for i, mark in enumerate(row):
                    if mark == "1":
                        self.rectangle(x + i * dot, y + j * dot, dot, dot, colour)
            x += (len(rows[0]) + 1) * dot


def facade(width: int = 28, per_metre: int = 96) -> NDArray[np.float32]:
    """A brick house front, ``width`` metres wide and 10 m high: (h, w, 3), 0 … 1."""
    canvas = Canvas(_bricks(width, 10, per_metre), per_metre)
    for y in (3.3, 6.5):
        canvas.rectangle(0, y, width, 0.35, _STONE)
        canvas.rectangle(0, y + 0.12, width, 0.03, _LINE)
        canvas.rectangle(0, y + 0.23, width, 0.03, _LINE)
    _cornice(canvas, width)
    for x in np.arange(1.0, width - 1.5, 2.4):
        _window(canvas, x, 1.1, 1.3, 1.9)
        _window(canvas, x, 4.2, 1.3, 1.9)
    _shops(canvas, width)
    return canvas.pixels


def _bricks(width: float, height: float, per_metre: int) -> NDArray[np.float32]:
    rng = np.random.default_rng(11)
    shape = round(height * per_metre), round(width * per_metre)
    y, x = np.indices(shape, dtype=np.float32) / per_metre
    row = np.floor(y / 0.2).astype(np.intp)
    shifted = x + 0.25 * (row % 2)
    column = np.floor(shifted / 0.5).astype(np.intp)
    tone = rng.uniform(0.82, 1.12, (row.max() + 1, column.max() + 1, 1)).astype(np.float32)
    brick = np.array([0.60, 0.31, 0.23], np.float32) * tone[row, column]
    mortar = (y % 0.2 < 0.03) | (shifted % 0.5 < 0.03)
    return np.where(mortar[:, :, None], np.array([0.75, 0.70, 0.63], np.float32), brick)


def _cornice(canvas: Canvas, width: float) -> None:
    canvas.rectangle(0, 0, width, 0.6, _STONE)
    canvas.rectangle(0, 0.15, width, 0.04, _LINE)
    for x in np.arange(0.1, width, 0.4):
        canvas.rectangle(x, 0.3, 0.2, 0.2, _LINE)


def _window(canvas: Canvas, x: float, y: float, width: float, height: float) -> None:
    canvas.rectangle(x - 0.15, y - 0.15, width + 0.3, height + 0.3, _STONE)
    canvas.rectangle(x - 0.25, y + height + 0.1, width + 0.5, 0.12, _WHITE)
    canvas.rectangle(x, y, width, height, _WHITE)
    columns, rows, bar = 2, 3, 0.07
    pane = ((width - bar) / columns - bar, (height - bar) / rows - bar)
    for i in range(columns):
        for j in range(rows):
            canvas.rectangle(x + bar + i * (pane[0] + bar), y + bar + j * (pane[1] + bar), *pane, _GLASS)


def _shops(canvas: Canvas, width: float) -> None:
    """The ground floor: doors, shutters and sheets of ruled paper in turn, and a sign above the middle."""
    for i, x in enumerate(np.arange(1.0, width - 2.0, 3.0)):
        (_shutter, _door, _ruled_paper)[i % 3](canvas, x)
    letters = "PINHOLE"
    dot = 0.09
    length = dot * sum(len(_LETTERS[letter][0]) + 1 for letter in letters)
    canvas.rectangle(width / 2 - length / 2 - 0.3, 6.38, length + 0.6, 0.95, _WHITE)
    canvas.text(letters, width / 2 - length / 2 + dot / 2, 6.55, dot, _INK)


def _shutter(canvas: Canvas, x: float) -> None:
    canvas.rectangle(x, 7.6, 2.2, 2.4, _WHITE)
    for y in np.arange(7.7, 10, 0.16):
        canvas.rectangle(x + 0.08, y, 2.04, 0.08, _LINE)


def _door(canvas: Canvas, x: float) -> None:
    canvas.rectangle(x + 0.2, 7.5, 1.8, 2.5, _STONE)
    canvas.rectangle(x + 0.4, 7.7, 1.4, 2.3, _DOOR)
    for i in range(2):
        for j in range(3):
            canvas.rectangle(x + 0.52 + 0.62 * i, 7.85 + 0.7 * j, 0.52, 0.55, _GLASS)


def _ruled_paper(canvas: Canvas, x: float) -> None:
    canvas.rectangle(x, 7.6, 2.2, 1.9, _WHITE)
    for y in np.arange(7.8, 9.4, 0.2):
        canvas.rectangle(x + 0.1, y, 2.0, 0.03, _INK)
    for u in np.arange(0.3, 2.1, 0.4):
        canvas.rectangle(x + u, 7.7, 0.03, 1.7, (0.72, 0.20, 0.20))


def pavement(xy: Floats) -> Floats:
    """Colours (N, 3) at ``xy`` (N, 2) of square one-metre slabs, alternately light and dark, with joints."""
    dark = np.floor(xy).sum(axis=1) % 2 == 1
    joint = (xy[:, 0] % 1 < 0.04) | (xy[:, 1] % 1 < 0.04)
    slabs = np.where(dark[:, None], (0.42, 0.41, 0.40), (0.68, 0.66, 0.62))
    return np.where(joint[:, None], (0.25, 0.24, 0.23), slabs)


def sky(directions: Floats) -> Floats:
    """Colours (N, 3) of a sky that gets paler towards the horizon; y of ``directions`` (N, 3) points down."""
    height = np.clip(-directions[:, 1:2], 0, 1)
    return np.asarray(np.array([0.80, 0.87, 0.93]) + height * np.array([-0.45, -0.30, -0.10]))
