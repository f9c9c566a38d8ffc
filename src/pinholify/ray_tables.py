"""Cached tables between a camera's pixels and the directions they see, in stereographic coordinates.

A table holds stereographic coordinates far better than those of a plane, because they do not end at 90°. Tables are
made when they are first needed and kept for the next call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.arrays import Floats
from pinholify.camera import VirtualCamera
from pinholify.expansion import PointMap
from pinholify.geometry import image_grid
from pinholify.tables import BLOCK, PointTable, point_table

CACHED_CAMERAS = 8
"""Tables kept of each kind."""

SAMPLES = 12
"""Points along each side of the image at which the extent of the visible directions is determined."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What pixels (n, 2) see: ``coordinates`` (n, 2), which ``directions`` converts to unit vectors (n, 3)."""

    coordinates: PointMap
    directions: Callable[[Floats], Floats]

    def map(self, uv: Floats, out: Floats, finish: Callable[[Floats], Floats]) -> Floats:
        """``out`` (n, m), filled in blocks with ``finish`` of the directions (k, 3) of the pixels ``uv`` (n, 2)."""
        coordinates = self.coordinates(uv)
        for start in range(0, len(uv), BLOCK):
            block = slice(start, start + BLOCK)
            out[block] = finish(self.directions(coordinates[block]))
        return out


def exact_sight(camera: VirtualCamera) -> Sight:
    """The camera's own map."""
    return Sight(partial(_coordinates, camera), camera.chart.directions)


@lru_cache(maxsize=CACHED_CAMERAS)
def tabulated_sight(camera: VirtualCamera, tolerance: float) -> Sight:
    """The camera's map by a table whose error is at most ``tolerance`` px of the image."""
    sphere = _sphere(camera)

    def coordinates(uv: Floats) -> Floats:
        return sphere.coordinates(camera.chart.directions(_coordinates(camera, uv)))

    return Sight(point_table(coordinates, camera.image_size, tolerance=tolerance), sphere.directions)


def _coordinates(camera: VirtualCamera, uv: Floats) -> Floats:
    """Chart coordinates (n, 2) of pixels ``uv`` (n, 2); nan for pixels that are not finite."""
    q, known = np.full(uv.shape, np.nan), np.isfinite(uv).all(axis=1)
    if known.any():
        q[known] = camera.plane_map.value(uv[known])
    return q


def tabulated_pixels(camera: VirtualCamera, xyz: Floats, tolerance: float) -> Floats:
    """Pixels (n, 2) that see ``xyz`` (n, 3), by a table whose error is at most ``tolerance`` px; nan where none do."""
    box = _box(camera)
    return _pixel_table(camera, tolerance)((_sphere(camera).coordinates(xyz) - box.low) / box.px)


@lru_cache(maxsize=CACHED_CAMERAS)
def _pixel_table(camera: VirtualCamera, tolerance: float) -> PointTable:
    """The table from stereographic coordinates, in units of :class:`_Box`, to pixels."""
    sphere, box = _sphere(camera), _box(camera)

    def pixels(place: Floats) -> Floats:
        return camera.project(sphere.directions(place * box.px + box.low))

    return point_table(pixels, camera.image_size, tolerance=tolerance, of_answer=True)


@dataclass(frozen=True, slots=True, eq=False)
class _Sphere:
    """Stereographic coordinates about the mean direction of a camera: smooth everywhere except straight behind.

    ``rotation`` (3, 3) turns that direction to the z axis.
    """

    rotation: Floats

    def coordinates(self, xyz: Floats) -> Floats:
        """(x, y) / (‖xyz‖ + z), (n, 2), of ``xyz`` (n, 3)."""
        x, y, z = self.rotation @ xyz.T
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.stack([x, y], axis=1) / (np.sqrt(x**2 + y**2 + z**2) + z)[:, None])

    def directions(self, s: Floats) -> Floats:
        """Unit vectors (n, 3) of the coordinates ``s`` (n, 2)."""
        x, y = s.T
        square = x**2 + y**2
        return np.asarray((self.rotation.T @ (np.stack([2.0 * x, 2.0 * y, 1.0 - square]) / (1.0 + square))).T)


@lru_cache(maxsize=CACHED_CAMERAS)
def _sphere(camera: VirtualCamera) -> _Sphere:
    directions = _across_the_image(camera)
    return _Sphere(Rotation.align_vectors([[0.0, 0.0, 1.0]], [np.nanmean(directions, axis=0)])[0].as_matrix())


@dataclass(frozen=True, slots=True, eq=False)
class _Box:
    """The range of a camera in the coordinates of its :class:`_Sphere`: ``low`` (2,), and ``px`` (2,) per pixel."""

    low: Floats
    px: Floats


@lru_cache(maxsize=CACHED_CAMERAS)
def _box(camera: VirtualCamera) -> _Box:
    seen = _sphere(camera).coordinates(_across_the_image(camera))
    low, high = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)
    return _Box(low, (high - low) / camera.image_size)


def _across_the_image(camera: VirtualCamera) -> Floats:
    """Unit directions (n, 3) of pixels all over the image."""
    return camera.chart.directions(camera.plane_map.value(image_grid(camera.image_size, SAMPLES, to_edges=True)))
