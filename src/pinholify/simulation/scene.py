"""Scenes: textured planes in front of a background, and the tracing of rays into them.

A texture gives the colours (N, channels), 0 black … 1 white, of points (N, 2) of its plane, NaN where the plane has a
hole or ends; a background gives the colours of directions (N, 3). All textures of a scene have the same channels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import Checkerboard
from pinholify.geometry import Pose
from pinholify.simulation.lenses import LensRays

Texture = Callable[[Floats], Floats]
Background = Callable[[Floats], Floats]


@dataclass(frozen=True, slots=True, eq=False)
class TexturedPlane:
    """The plane z = 0 of the frame ``pose`` (camera_from_plane), with ``texture`` on both sides."""

    pose: Pose
    texture: Texture

    def intersect(self, rays: LensRays) -> tuple[Floats, Floats]:
        """Distances (N,) along ``rays`` to the plane, inf for rays that do not meet it, and the points (N, 2) there."""
        normal, axes = self.pose.rotation[:, 2], self.pose.rotation[:, :2]
        start = rays.origins - self.pose.translation
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -(start @ normal) / (rays.directions @ normal)
            distance = np.where(distance > 0, distance, np.inf)
            return distance, start @ axes + distance[:, None] * (rays.directions @ axes)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """``planes``, in any order, that occlude one another, in front of an infinitely distant ``background``."""

    planes: tuple[TexturedPlane, ...]
    background: Background

    def trace(self, rays: LensRays) -> Floats:
        """The colours (N, channels) that ``rays`` see; black for a ray of NaN."""
        nearest = np.full(len(rays.directions), np.inf)
        hits: list[tuple[Ints, Floats]] = []
        for plane in self.planes:
            distance, xy = plane.intersect(rays)
            rows = np.flatnonzero(distance < nearest)
            colour = plane.texture(xy[rows])
            seen = np.isfinite(colour[:, 0])
            hits.append((rows[seen], colour[seen]))
            nearest[rows[seen]] = distance[rows[seen]]
        rows = np.flatnonzero(nearest == np.inf)
        beyond = self.background(rays.directions[rows])
        colours = np.empty((len(nearest), beyond.shape[1]))
        for where, colour in [*hits, (rows, np.nan_to_num(beyond, nan=0.0))]:
            colours[where] = colour
        return colours


@dataclass(frozen=True, slots=True)
class CheckerboardTexture:
    """``board`` on a sheet with a light ``margin`` (squares); the square diagonally beyond corner (0, 0) is dark.

    Corner (0, 0) is the origin and a square is the unit of length, as in the board's lattice coordinates.
    """

    board: Checkerboard
    margin: float = 0.7
    dark: float = 0.07
    light: float = 0.9

    def __call__(self, xy: Floats) -> Floats:
        """Colours (N, 1) of ``xy`` (N, 2)."""
        x, y = xy.T
        even = (np.floor(x) + np.floor(y)).astype(np.int64) & 1 == 0
        colour = np.where(even & self._within(xy, 0), self.dark, self.light)
        return np.asarray(np.where(self._within(xy, self.margin), colour, np.nan)[:, None])

    def _within(self, xy: Floats, margin: float) -> Bools:
        """Whether ``xy`` (N, 2) lies on the squares or at most ``margin`` beyond them."""
        around = 1 + 2 * margin
        return _inside(xy + (1 + margin), self.board.columns + around, self.board.rows + around)


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """``pixels`` (h, w, channels), 0 … 1, on a plane, ``per_unit`` pixels per unit of length, interpolated bilinearly.

    The centre of pixel (0, 0) lies at ``origin`` of the plane; x runs along rows, y down.
    """

    pixels: NDArray[np.float32]
    per_unit: float
    origin: tuple[float, float] = (0.0, 0.0)

    def __call__(self, xy: Floats) -> Floats:
        """Colours (N, channels) of ``xy`` (N, 2); NaN outside the picture."""
        height, width = self.pixels.shape[:2]
        at = (xy - self.origin) * self.per_unit
        inside = _inside(at, width - 1, height - 1)
        at = np.where(inside[:, None], at, 0.0)
        column, row = np.minimum(at.astype(np.intp), (width - 2, height - 2)).T
        fx, fy = (at - np.stack([column, row], axis=1)).T[:, :, None]
        p = self.pixels
        upper = p[row, column] * (1 - fx) + p[row, column + 1] * fx
        lower = p[row + 1, column] * (1 - fx) + p[row + 1, column + 1] * fx
        return np.where(inside[:, None], upper * (1 - fy) + lower * fy, np.nan)


def _inside(xy: Floats, width: float, height: float) -> Bools:
    """Which (N,) of ``xy`` (N, 2) lie in the rectangle from the origin: by columns, because rows of two are slow."""
    x, y = xy.T
    return np.asarray((x >= 0) & (x <= width) & (y >= 0) & (y <= height))


def plain(*colour: float) -> Background:
    """A background of one ``colour``."""
    return lambda directions: np.where(np.isfinite(directions[:, :1]), np.array(colour), np.nan)


def cloudy(*colour: float, contrast: float = 0.2, seed: int = 0) -> Background:
    """A background of ``colour`` with large, soft blotches that vary it by up to the share ``contrast``."""
    rng = np.random.default_rng(seed)
    waves, phases = rng.normal(0, 3.0, (3, 8)), rng.uniform(0, 2 * np.pi, 8)

    def background(directions: Floats) -> Floats:
        brightness = 1 + contrast * np.sin(directions @ waves + phases) @ np.full((8, 1), 1 / 8)
        return np.asarray(brightness * np.array(colour))

    return background
