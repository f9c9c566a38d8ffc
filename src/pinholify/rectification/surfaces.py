"""What a view is painted on, a plane, a cylinder or a sphere around the camera's centre, in two coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinholify.arrays import Floats
from pinholify.geometry import homogeneous


class Surface(Protocol):
    """Two coordinates of directions in the view's frame: x to the right, y down, z ahead."""

    @property
    def widest_fov(self) -> float:
        """The largest horizontal field of view that a picture can have, degrees."""
        ...

    def width(self, fov: float) -> float:
        """How wide a horizontal field of view of ``fov`` radians is on the surface."""
        ...

    def directions(self, q: Floats) -> Floats:
        """Directions (n, 3) of the coordinates ``q`` (n, 2), of any length; nan beyond the surface's end."""
        ...

    def coordinates(self, xyz: Floats) -> Floats:
        """Coordinates (n, 2) of the directions ``xyz`` (n, 3); nan where the surface has none."""
        ...

    def steepness(self, xyz: Floats) -> Floats:
        """Angles (n,) in radians of directions ``xyz`` (n, 3), towards 90° of which pictures grow without bound."""
        ...


@dataclass(frozen=True, slots=True)
class Plane:
    """(x/z, y/z): straight lines stay straight."""

    widest_fov = 170.0

    def width(self, fov: float) -> float:
        """2 tan(fov/2)."""
        return float(2.0 * np.tan(fov / 2.0))

    def directions(self, q: Floats) -> Floats:
        """With z = 1."""
        return homogeneous(q)

    def coordinates(self, xyz: Floats) -> Floats:
        """Nan at 90° from the axis and beyond."""
        return np.asarray(xyz[:, :2] / np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan))

    def steepness(self, xyz: Floats) -> Floats:
        """From the axis."""
        return np.asarray(np.arctan2(np.hypot(xyz[:, 0], xyz[:, 1]), xyz[:, 2]))


@dataclass(frozen=True, slots=True)
class Cylinder:
    """(azimuth in radians, height over radius), about the y axis: upright lines stay straight, all around."""

    widest_fov = 360.0

    def width(self, fov: float) -> float:
        """The angle itself."""
        return fov

    def directions(self, q: Floats) -> Floats:
        """Of length one across the axis."""
        azimuth = np.where(np.abs(q[:, 0]) <= np.pi, q[:, 0], np.nan)
        return np.stack([np.sin(azimuth), q[:, 1], np.cos(azimuth)], axis=1)

    def coordinates(self, xyz: Floats) -> Floats:
        """Infinite along the axis."""
        with np.errstate(divide="ignore", invalid="ignore"):
            height = xyz[:, 1] / np.hypot(xyz[:, 0], xyz[:, 2])
        return np.stack([np.arctan2(xyz[:, 0], xyz[:, 2]), height], axis=1)

    def steepness(self, xyz: Floats) -> Floats:
        """Above and below the horizon."""
        return np.asarray(np.arctan2(np.abs(xyz[:, 1]), np.hypot(xyz[:, 0], xyz[:, 2])))


@dataclass(frozen=True, slots=True)
class Sphere:
    """(azimuth, angle below the horizon) in radians: the equirectangular picture, which holds every direction."""

    widest_fov = 360.0

    def width(self, fov: float) -> float:
        """The angle itself."""
        return fov

    def directions(self, q: Floats) -> Floats:
        """Unit vectors."""
        azimuth = np.where(np.abs(q[:, 0]) <= np.pi, q[:, 0], np.nan)
        below = np.where(np.abs(q[:, 1]) <= np.pi / 2.0, q[:, 1], np.nan)
        across = np.cos(below)
        return np.stack([across * np.sin(azimuth), np.sin(below), across * np.cos(azimuth)], axis=1)

    def coordinates(self, xyz: Floats) -> Floats:
        """Defined everywhere."""
        below = np.arctan2(xyz[:, 1], np.hypot(xyz[:, 0], xyz[:, 2]))
        return np.stack([np.arctan2(xyz[:, 0], xyz[:, 2]), below], axis=1)

    def steepness(self, xyz: Floats) -> Floats:
        """None: the picture is finite."""
        return np.zeros(len(xyz))
