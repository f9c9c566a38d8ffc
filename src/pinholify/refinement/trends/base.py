"""The interface of trends of the joint solve: parametric cameras between rays and normalised image coordinates.

A ray is given by two chart coordinates c: its point on the plane z = 1, or its azimuthal equidistant angles. Rays are
in the axes of the joint solve, image points in those of :class:`~pinholify.refinement.observations.ImageFrame`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.charts import (
    angles_to_directions,
    angles_to_directions_jacobian,
    directions_to_angles,
    directions_to_angles_jacobian,
)

MIN_PLANE_COSINE = 0.05  # of the angle from the axis: rays farther out have no coordinates on the plane


class RayChart(Protocol):
    """Two coordinates c of a ray."""

    def coordinates(self, xyz: Floats) -> Floats:
        """Coordinates (n, 2) of the rays through ``xyz`` (n, 3), nan where the chart does not reach."""
        ...

    def coordinate_jacobian(self, xyz: Floats) -> Floats:
        """∂c/∂xyz at ``xyz`` (n, 3): (n, 2, 3)."""
        ...

    def directions(self, c: Floats) -> Floats:
        """Directions (n, 3), of any length, of coordinates ``c`` (n, 2)."""
        ...

    def direction_jacobian(self, c: Floats) -> Floats:
        """∂direction/∂c at ``c`` (n, 2): (n, 3, 2)."""
        ...


@dataclass(frozen=True, slots=True)
class Plane:
    """The chart c = (x/z, y/z), for rays in front of the camera."""

    def coordinates(self, xyz: Floats) -> Floats:
        """Coordinates (n, 2) of the rays through ``xyz`` (n, 3), nan towards and beyond 90° from the axis."""
        reached = xyz[:, 2] > MIN_PLANE_COSINE * np.linalg.norm(xyz, axis=1)
        return np.asarray(xyz[:, :2] / np.where(reached, xyz[:, 2], np.nan)[:, None])

    def coordinate_jacobian(self, xyz: Floats) -> Floats:
        """∂c/∂xyz at ``xyz`` (n, 3): (n, 2, 3)."""
        jacobian = np.zeros((len(xyz), 2, 3))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0 / xyz[:, 2]
        jacobian[:, :, 2] = -xyz[:, :2] / xyz[:, 2:] ** 2
        return jacobian

    def directions(self, c: Floats) -> Floats:
        """Directions (n, 3) with z = 1 of coordinates ``c`` (n, 2)."""
        return np.concatenate([c, np.ones((len(c), 1))], axis=1)

    def direction_jacobian(self, c: Floats) -> Floats:
        """∂direction/∂c at ``c`` (n, 2): (n, 3, 2), the same everywhere."""
        return np.broadcast_to(np.eye(3)[:, :2], (len(c), 3, 2))


@dataclass(frozen=True, slots=True)
class Angles:
    """The chart c = θ (cos φ, sin φ) in radians, with θ the angle from the axis and φ the azimuth, for all rays."""

    def coordinates(self, xyz: Floats) -> Floats:
        """Angles (n, 2) of the rays through ``xyz`` (n, 3)."""
        return directions_to_angles(xyz)

    def coordinate_jacobian(self, xyz: Floats) -> Floats:
        """∂c/∂xyz at ``xyz`` (n, 3): (n, 2, 3)."""
        return directions_to_angles_jacobian(xyz)

    def directions(self, c: Floats) -> Floats:
        """Unit directions (n, 3) of angles ``c`` (n, 2)."""
        return angles_to_directions(c)

    def direction_jacobian(self, c: Floats) -> Floats:
        """∂direction/∂c at ``c`` (n, 2): (n, 3, 2)."""
        return angles_to_directions_jacobian(c)


class Trend(Protocol):
    """A family of cameras with parameters β (p,), whose independent normal priors have mean zero."""

    @property
    def name(self) -> str:
        """The trend's name in reports, which starts with family and order, as in ``plane:3``."""
        ...

    @property
    def family(self) -> str:
        """The name without the order; the orders of a family are nested."""
        ...

    @property
    def chart(self) -> RayChart:
        """The chart of the ray coordinates c."""
        ...

    @property
    def order(self) -> int:
        """The number of radial coefficients, or the degree of a polynomial."""
        ...

    def of_order(self, order: int) -> Trend:
        """The same trend with another order."""
        ...

    def around(self) -> Search:
        """A search of the trends similar to this one, for a second and closer look."""
        ...

    def kept(self, smaller: Trend) -> Bools:
        """Mask (p,) of the β that the ``smaller`` trend has too; it is this trend with the others at zero."""
        ...

    @property
    def level(self) -> bool:
        """Whether, by definition, the ray of the image's middle is c = 0 and the camera has no roll there."""
        ...

    @property
    def inverse_is_iterative(self) -> bool:
        """Whether :meth:`image` is iterative and needs points ``near`` its result."""
        ...

    @property
    def prior_std(self) -> Floats:
        """Standard deviations (p,) of β under the prior."""
        ...

    def start(self, w: Floats, c: Floats) -> Floats:
        """A first β (p,), by linear estimates, for the rays ``c`` (n, 2) seen at ``w`` (n, 2)."""
        ...

    def resembling(self, other: Trend, beta: Floats) -> Floats | None:
        """This trend's β (p,) with the values that ``other`` has for shared parameters in its ``beta``, the rest zero.

        None where the two share no parameters, or where :meth:`start` is as good.
        """
        ...

    def image(self, beta: Floats, c: Floats, near: Floats) -> Floats:
        """Image points w (n, 2) of rays ``c`` (n, 2), close to ``near`` (n, 2); nan where there is none."""
        ...

    def ray(self, beta: Floats, w: Floats) -> Floats:
        """Ray coordinates c (n, 2) of image points ``w`` (n, 2); nan where there is none."""
        ...

    def jacobians(self, beta: Floats, w: Floats, c: Floats) -> tuple[Floats, Floats]:
        """∂w/∂c (n, 2, 2), and ∂w/∂β at fixed c (n, 2, p), where ``w`` and ``c`` (n, 2) correspond."""
        ...

    def folds(self, beta: Floats, points: Floats) -> bool:
        """Whether the trend fails to be one to one on the part of the image that ``points`` (n, 2) cover."""
        ...


@dataclass(frozen=True, slots=True)
class Search:
    """A ``general`` trend to solve, and the trends ``within`` it, itself included, that follow by linear algebra."""

    general: Trend
    within: tuple[Trend, ...]
