"""The homography: the map from image to board of a camera without distortion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.geometry import (
    apply_homography,
    estimate_homography,
    homography_jacobian,
    homography_parameter_jacobian,
)

PARAMETERS = 8  # all entries but the last, which is 1
AFFINE_STD = 10.0
PERSPECTIVE_STD = 1.0


def matrix(beta: Floats) -> Floats:
    """The homography (3, 3) of parameters ``beta`` (8,): its entries row by row, of which the last is 1."""
    return np.append(beta, 1.0).reshape(3, 3)


@dataclass(frozen=True, slots=True)
class Homography:
    """The trend h(x) = H x in homogeneous coordinates; β (8,) are the entries of H row by row."""

    @property
    def name(self) -> str:
        """The registry's name, ``homography``."""
        return "homography"

    @property
    def prior_mean(self) -> Floats:
        """Mean (8,) of β under the prior: zero."""
        return np.zeros(PARAMETERS)

    @property
    def prior_std(self) -> Floats:
        """Standard deviations (8,): wide for the affine part; a vanishing line inside the unit circle is unlikely."""
        return np.array([AFFINE_STD] * 6 + [PERSPECTIVE_STD] * 2)

    def start(self, x: Floats, y: Floats) -> Floats:
        """The β (8,) of the least-squares homography from ``x`` to ``y``, both (n, 2)."""
        return estimate_homography(x, y).ravel()[:PARAMETERS]

    def value(self, beta: Floats, x: Floats) -> Floats:
        """The points ``x`` (n, 2) mapped by H: (n, 2)."""
        return apply_homography(matrix(beta), x)

    def input_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂x at ``x`` (n, 2): (n, 2, 2)."""
        return homography_jacobian(matrix(beta), x)

    def parameter_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂h/∂β at ``x`` (n, 2): (n, 2, 8)."""
        return homography_parameter_jacobian(matrix(beta), x)[:, :, :PARAMETERS]
