"""What a trend of the joint solve is: a parametric camera between rays and normalised image coordinates.

A ray enters by two chart coordinates c, on the plane z = 1 or as azimuthal equidistant angles.
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

NEAREST_TO_PLANE = 0.05  # cosine of the largest angle from the axis that the plane is trusted with


class RayChart(Protocol):
    """Two coordinates of a ray."""

    def coordinates(self, xyz: Floats) -> Floats:
        """c (n, 2) of rays through ``xyz`` (n, 3), nan where the chart does not reach."""
        ...

    def coordinate_jacobian(self, xyz: Floats) -> Floats:
        """∂c/∂xyz, (n, 2, 3)."""
        ...

    def directions(self, c: Floats) -> Floats:
        """Directions (n, 3) of ``c`` (n, 2), of any length."""
        ...

    def direction_jacobian(self, c: Floats) -> Floats:
        """∂ directions/∂c, (n, 3, 2)."""
        ...


@dataclass(frozen=True, slots=True)
class Plane:
    """c = (x/z, y/z)."""

    def coordinates(self, xyz: Floats) -> Floats:
        """c."""
        reached = xyz[:, 2] > NEAREST_TO_PLANE * np.linalg.norm(xyz, axis=1)
        return np.asarray(xyz[:, :2] / np.where(reached, xyz[:, 2], np.nan)[:, None])

    def coordinate_jacobian(self, xyz: Floats) -> Floats:
        """∂c/∂xyz."""
        jacobian = np.zeros((len(xyz), 2, 3))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0 / xyz[:, 2]
        jacobian[:, :, 2] = -xyz[:, :2] / xyz[:, 2:] ** 2
        return jacobian

    def directions(self, c: Floats) -> Floats:
        """(c, 1)."""
        return np.concatenate([c, np.ones((len(c), 1))], axis=1)

    def direction_jacobian(self, c: Floats) -> Floats:
        """Constant."""
        return np.broadcast_to(np.eye(3)[:, :2], (len(c), 3, 2))


@dataclass(frozen=True, slots=True)
class Angles:
    """c = θ (cos φ, sin φ)."""

    def coordinates(self, xyz: Floats) -> Floats:
        """c."""
        return directions_to_angles(xyz)

    def coordinate_jacobian(self, xyz: Floats) -> Floats:
        """∂c/∂xyz."""
        return directions_to_angles_jacobian(xyz)

    def directions(self, c: Floats) -> Floats:
        """Unit directions."""
        return angles_to_directions(c)

    def direction_jacobian(self, c: Floats) -> Floats:
        """∂ directions/∂c."""
        return angles_to_directions_jacobian(c)


class Trend(Protocol):
    """A family of cameras with parameters β (p,), each with an independent normal prior."""

    @property
    def name(self) -> str:
        """The name :func:`trends_named` reads back."""
        ...

    @property
    def family(self) -> str:
        """The name without the order; the orders of a family are nested."""
        ...

    @property
    def chart(self) -> RayChart:
        """Where c lives."""
        ...

    @property
    def order(self) -> int:
        """How many radial coefficients, or which degree."""
        ...

    def of_order(self, order: int) -> Trend:
        """The same family with another order."""
        ...

    def around(self) -> Search:
        """A search of the trends next to this one, for a second and closer look."""
        ...

    def kept(self, smaller: Trend) -> Bools:
        """Which of β (p,) a ``smaller`` trend has too; it is this trend with the others at zero."""
        ...

    @property
    def level(self) -> bool:
        """Whether the ray of the image's middle is c = 0 and the camera has no roll there, by definition."""
        ...

    @property
    def searches(self) -> bool:
        """Whether :meth:`image` needs to know what is near."""
        ...

    @property
    def prior_std(self) -> Floats:
        """Standard deviations of β under the prior, whose mean is zero, (p,)."""
        ...

    def start(self, w: Floats, c: Floats) -> Floats:
        """A first β, linear, for the rays ``c`` (n, 2) seen at ``w`` (n, 2)."""
        ...

    def resembling(self, other: Trend, beta: Floats) -> Floats | None:
        """The numbers that this trend shares with ``other`` as that has them in its ``beta``, the rest zero; None where
        the linear start is as good.
        """
        ...

    def image(self, beta: Floats, c: Floats, near: Floats) -> Floats:
        """w (n, 2) of rays ``c`` (n, 2), in the neighbourhood of ``near`` (n, 2); nan where there is none."""
        ...

    def ray(self, beta: Floats, w: Floats) -> Floats:
        """c (n, 2) of image points ``w`` (n, 2); nan where there is none."""
        ...

    def jacobians(self, beta: Floats, w: Floats, c: Floats) -> tuple[Floats, Floats]:
        """∂w/∂c (n, 2, 2) and ∂w/∂β at fixed c (n, 2, p), for pairs that belong together."""
        ...

    def folds(self, beta: Floats, points: Floats) -> bool:
        """Whether the trend is not one to one on an area of the image that holds ``points`` (n, 2)."""
        ...


@dataclass(frozen=True, slots=True)
class Search:
    """A trend to solve, and the trends ``within`` it, itself among them, that follow from it by linear
    algebra.
    """

    general: Trend
    within: tuple[Trend, ...]
