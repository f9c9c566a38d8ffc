"""Surfaces that views are projected on: a plane, a cylinder or a sphere around the camera's centre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinholify.arrays import Floats
from pinholify.geometry import homogeneous


class Surface(Protocol):
    """Two coordinates for directions in the view's frame: x to the right, y down, z forward."""

    @property
    def widest_fov(self) -> float:
        """The largest horizontal field of view that a view can have, in degrees."""
        ...

    def width(self, fov: float) -> float:
        """Width of a horizontal field of view of ``fov`` radians, in coordinates of the surface."""
        ...

    def directions(self, q: Floats) -> Floats:
        """Directions (n, 3), of any length, of the coordinates ``q`` (n, 2); nan beyond the surface's end."""
        ...

    def coordinates(self, xyz: Floats) -> Floats:
        """Coordinates (n, 2) of the directions ``xyz`` (n, 3); nan where the surface has none."""
        ...

    def steepness(self, xyz: Floats) -> Floats:
        """Angles (n,) in radians of ``xyz`` (n, 3); towards 90° the coordinates grow without bound."""
        ...


@dataclass(frozen=True, slots=True)
class FlatSurface:
    """(x/z, y/z): straight lines stay straight."""

    widest_fov = 170.0

    def width(self, fov: float) -> float:
        """2 tan(fov/2)."""
        return float(2.0 * np.tan(fov / 2.0))

    def directions(self, q: Floats) -> Floats:
        """Directions (n, 3) with z = 1 of ``q`` (n, 2)."""
        return homogeneous(q)

    def coordinates(self, xyz: Floats) -> Floats:
        """Coordinates (n, 2) of ``xyz`` (n, 3); nan at 90° from the axis and beyond."""
        return np.asarray(xyz[:, :2] / np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan))

    def steepness(self, xyz: Floats) -> Floats:
        """Angles (n,) in radians between ``xyz`` (n, 3) and the z axis."""
        return np.asarray(np.arctan2(np.hypot(xyz[:, 0], xyz[:, 1]), xyz[:, 2]))


@dataclass(frozen=True, slots=True)
class CylindricalSurface:
    """(azimuth in radians, height ÷ radius) about the y axis: vertical lines stay straight, all around."""

    widest_fov = 360.0

    def width(self, fov: float) -> float:
        """``fov`` itself."""
        return fov

    def directions(self, q: Floats) -> Floats:
        """Directions (n, 3), of length 1 across the y axis, of ``q`` (n, 2); nan for azimuths beyond ±π."""
        azimuth = np.where(np.abs(q[:, 0]) <= np.pi, q[:, 0], np.nan)
        return np.stack([np.sin(azimuth), q[:, 1], np.cos(azimuth)], axis=1)

    def coordinates(self, xyz: Floats) -> Floats:
        """Coordinates (n, 2) of ``xyz`` (n, 3); infinite along the y axis."""
        with np.errstate(divide="ignore", invalid="ignore"):
            height = xyz[:, 1] / np.hypot(xyz[:, 0], xyz[:, 2])
        return np.stack([np.arctan2(xyz[:, 0], xyz[:, 2]), height], axis=1)

    def steepness(self, xyz: Floats) -> Floats:
        """Angles (n,) in radians of ``xyz`` (n, 3) above or below the horizon, not negative."""
        return np.asarray(np.arctan2(np.abs(xyz[:, 1]), np.hypot(xyz[:, 0], xyz[:, 2])))


@dataclass(frozen=True, slots=True)
class SphericalSurface:
    """(azimuth, angle below the horizon) in radians: the equirectangular projection, which holds every direction."""

    widest_fov = 360.0

    def width(self, fov: float) -> float:
        """``fov`` itself."""
        return fov

    def directions(self, q: Floats) -> Floats:
        """Unit vectors (n, 3) of ``q`` (n, 2); nan for azimuths beyond ±π and angles beyond ±π/2."""
        azimuth = np.where(np.abs(q[:, 0]) <= np.pi, q[:, 0], np.nan)
        below = np.where(np.abs(q[:, 1]) <= np.pi / 2.0, q[:, 1], np.nan)
        across = np.cos(below)
        return np.stack([across * np.sin(azimuth), np.sin(below), across * np.cos(azimuth)], axis=1)

    def coordinates(self, xyz: Floats) -> Floats:
        """Coordinates (n, 2) of ``xyz`` (n, 3), defined for all directions."""
        below = np.arctan2(xyz[:, 1], np.hypot(xyz[:, 0], xyz[:, 2]))
        return np.stack([np.arctan2(xyz[:, 0], xyz[:, 2]), below], axis=1)

    def steepness(self, xyz: Floats) -> Floats:
        """Zeros (n,): the projection is bounded."""
        return np.zeros(len(xyz))


SURFACES: dict[str, Surface] = {
    "plane": FlatSurface(),
    "cylinder": CylindricalSurface(),
    "sphere": SphericalSurface(),
}
