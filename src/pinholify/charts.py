"""Charts: how the two coordinates that a map gives for a pixel represent a ray, and where the virtual plane is.

The one-image camera maps pixels to the virtual plane, the joint refinement maps them to angles, which stay bounded
where the plane ends. All other code works with either through this interface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinholify.arrays import Floats, frozen


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """K of the virtual camera: focal length ``f`` and principal point (``uc``, ``vc``), all in squares."""

    f: float
    uc: float
    vc: float

    @property
    def matrix(self) -> Floats:
        """K (3, 3) (paper equation K_sim_1)."""
        return np.array([[self.f, 0.0, self.uc], [0.0, self.f, self.vc], [0.0, 0.0, 1.0]])

    def directions(self, xy: Floats) -> Floats:
        """Directions (n, 3) with z = 1 through virtual points ``xy`` (n, 2)."""
        centred = (xy - [self.uc, self.vc]) / self.f
        return np.concatenate([centred, np.ones((len(xy), 1))], axis=1)

    def project(self, xyz: Floats) -> Floats:
        """Virtual points (n, 2) of points ``xyz`` (n, 3) in the camera frame; nan behind the camera."""
        z = np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan)
        return self.f * xyz[:, :2] / z + [self.uc, self.vc]

    def projection_jacobian(self, xyz: Floats) -> Floats:
        """Derivative (n, 2, 3) of :meth:`project`."""
        x, y, z = xyz.T
        z = np.where(z > 0, z, np.nan)
        jacobian = np.zeros((len(xyz), 2, 3))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = self.f / z
        jacobian[:, 0, 2], jacobian[:, 1, 2] = -self.f * x / z**2, -self.f * y / z**2
        return jacobian

    def parameter_jacobian(self, xyz: Floats) -> Floats:
        """Derivative (n, 2, 3) of :meth:`project` by (f, uc, vc)."""
        z = np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan)
        return np.concatenate([(xyz[:, :2] / z)[:, :, None], np.broadcast_to(np.eye(2), (len(xyz), 2, 2))], axis=2)


class Chart(Protocol):
    """Coordinates q (n, 2) of ray directions in the camera frame of the reference board."""

    @property
    def intrinsics(self) -> Intrinsics:
        """K of the virtual plane in that frame."""
        ...

    def directions(self, q: Floats) -> Floats:
        """Unit directions (n, 3) of ``q`` (n, 2)."""
        ...

    def direction_jacobian(self, q: Floats) -> Floats:
        """∂ direction/∂q, (n, 3, 2)."""
        ...

    def coordinates(self, xyz: Floats) -> Floats:
        """q (n, 2) of the rays through points ``xyz`` (n, 3); nan where the chart does not reach."""
        ...

    def coordinate_jacobian(self, xyz: Floats) -> Floats:
        """∂q/∂xyz, (n, 2, 3)."""
        ...

    def covariance(self, q: Floats) -> Floats:
        """Covariance (n, 2, 2) of the coordinates ``q`` (n, 2) of fixed rays, due to the chart's own uncertainty."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PlaneChart:
    """q is a point of the virtual plane, in squares.

    ``intrinsics_covariance`` (3, 3) is the covariance of (f, uc, vc) in squares², if it is known.
    """

    intrinsics: Intrinsics
    intrinsics_covariance: Floats | None = None

    def __post_init__(self) -> None:
        if self.intrinsics_covariance is not None:
            object.__setattr__(self, "intrinsics_covariance", frozen(self.intrinsics_covariance, (3, 3)))

    def directions(self, q: Floats) -> Floats:
        """Unit directions (n, 3) of ``q`` (n, 2)."""
        d = self.intrinsics.directions(q)
        return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))

    def direction_jacobian(self, q: Floats) -> Floats:
        """∂ direction/∂q, (n, 3, 2)."""
        d = self.intrinsics.directions(q)
        length = np.linalg.norm(d, axis=1)[:, None, None]
        unit = d[:, :, None] / length
        projector = np.eye(3) - unit * unit.transpose(0, 2, 1)
        return np.asarray(projector[:, :, :2] / (length * self.intrinsics.f))

    def coordinates(self, xyz: Floats) -> Floats:
        """Virtual points (n, 2) in squares of ``xyz`` (n, 3); nan at 90° from the axis and beyond."""
        return self.intrinsics.project(xyz)

    def coordinate_jacobian(self, xyz: Floats) -> Floats:
        """∂q/∂xyz, (n, 2, 3)."""
        return self.intrinsics.projection_jacobian(xyz)

    def covariance(self, q: Floats) -> Floats:
        """Covariance (n, 2, 2) in squares² due to that of K; zero if that is not known."""
        by_k = self.intrinsics.parameter_jacobian(self.intrinsics.directions(q))
        k = np.zeros((3, 3)) if self.intrinsics_covariance is None else self.intrinsics_covariance
        return np.asarray(by_k @ k @ by_k.transpose(0, 2, 1))


@dataclass(frozen=True, slots=True, eq=False)
class AngleChart:
    """q = θ (cos φ, sin φ), azimuthal equidistant in radians about the z axis of the map's own frame.

    ``rotation`` (3, 3) rotates directions of that frame to the camera frame of the reference board. The virtual plane
    there, of K ``intrinsics``, has no part in q.
    """

    rotation: Floats
    intrinsics: Intrinsics

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3)))

    def directions(self, q: Floats) -> Floats:
        """Unit directions (n, 3) of ``q`` (n, 2)."""
        return angles_to_directions(q) @ self.rotation.T

    def direction_jacobian(self, q: Floats) -> Floats:
        """∂ direction/∂q, (n, 3, 2)."""
        return np.asarray(self.rotation @ angles_to_directions_jacobian(q))

    def coordinates(self, xyz: Floats) -> Floats:
        """Angles (n, 2) in radians of ``xyz`` (n, 3); nan straight behind."""
        return directions_to_angles(xyz @ self.rotation)

    def coordinate_jacobian(self, xyz: Floats) -> Floats:
        """∂q/∂xyz, (n, 2, 3)."""
        return np.asarray(directions_to_angles_jacobian(xyz @ self.rotation) @ self.rotation.T)

    def covariance(self, q: Floats) -> Floats:
        """Zeros (n, 2, 2): the map's covariance includes everything."""
        return np.zeros((len(q), 2, 2))


def angles_to_directions(q: Floats) -> Floats:
    """Unit directions (n, 3) of azimuthal equidistant angles ``q`` (n, 2) in radians."""
    theta = np.linalg.norm(q, axis=1, keepdims=True)
    return np.concatenate([q * np.sinc(theta / np.pi), np.cos(theta)], axis=1)


def angles_to_directions_jacobian(q: Floats) -> Floats:
    """Derivative (n, 3, 2) of :func:`angles_to_directions`."""
    theta = np.linalg.norm(q, axis=1)
    sinc = np.sinc(theta / np.pi)
    safe = np.maximum(theta, 1e-4)
    slope = np.where(theta < 1e-3, -1.0 / 3.0 + theta**2 / 30.0, (np.cos(safe) - np.sin(safe) / safe) / safe**2)
    upper = sinc[:, None, None] * np.eye(2) + slope[:, None, None] * q[:, :, None] * q[:, None, :]
    return np.concatenate([upper, (-sinc[:, None] * q)[:, None, :]], axis=1)


def directions_to_angles(xyz: Floats) -> Floats:
    """Azimuthal equidistant angles (n, 2) in radians of the rays through ``xyz`` (n, 3); nan straight behind."""
    rho = np.hypot(xyz[:, 0], xyz[:, 1])
    theta = np.arctan2(rho, xyz[:, 2])
    near = rho < 1e-9 * np.abs(xyz[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where(near, 1.0 / xyz[:, 2], theta / rho)
    return np.asarray(xyz[:, :2] * np.where(near & (xyz[:, 2] <= 0), np.nan, factor)[:, None])


def directions_to_angles_jacobian(xyz: Floats) -> Floats:
    """Derivative (n, 2, 3) of :func:`directions_to_angles`."""
    x, y, z = xyz.T
    rho2 = x**2 + y**2
    rho, r2 = np.sqrt(rho2), rho2 + z**2
    near = rho2 < 1e-8 * r2
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where(near, (1.0 - rho2 / (3.0 * z**2)) / z, np.arctan2(rho, z) / rho)
        slope = np.where(near, -2.0 / (3.0 * z**3), (z / r2 - factor) / rho2)
    jacobian = np.empty((len(xyz), 2, 3))
    jacobian[:, :, :2] = factor[:, None, None] * np.eye(2)
    jacobian[:, :, :2] += slope[:, None, None] * xyz[:, :2, None] * xyz[:, None, :2]
    jacobian[:, :, 2] = -xyz[:, :2] / r2[:, None]
    return jacobian
