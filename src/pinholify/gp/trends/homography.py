"""The homography: what a distortion-free camera does to a flat board."""

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

PARAMETERS = 8
AFFINE_STD = 10.0
PERSPECTIVE_STD = 1.0


def matrix(beta: Floats) -> Floats:
    """The homography (3, 3) of parameters (8,): its entries row by row, the last one is 1."""
    return np.append(beta, 1.0).reshape(3, 3)


@dataclass(frozen=True, slots=True)
class Homography:
    """h(x) = H x in homogeneous coordinates."""

    @property
    def name(self) -> str:
        """``homography``."""
        return "homography"

    @property
    def prior_mean(self) -> Floats:
        """Zero: the prior is weak."""
        return np.zeros(PARAMETERS)

    @property
    def prior_std(self) -> Floats:
        """Wide for the affine part; a vanishing line nearer than the unit circle is unlikely."""
        return np.array([AFFINE_STD] * 6 + [PERSPECTIVE_STD] * 2)

    def start(self, x: Floats, y: Floats) -> Floats:
        """The least-squares homography."""
        return estimate_homography(x, y).ravel()[:PARAMETERS]

    def value(self, beta: Floats, x: Floats) -> Floats:
        """H x."""
        return apply_homography(matrix(beta), x)

    def input_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂(H x)/∂x."""
        return homography_jacobian(matrix(beta), x)

    def parameter_jacobian(self, beta: Floats, x: Floats) -> Floats:
        """∂(H x)/∂H."""
        return homography_parameter_jacobian(matrix(beta), x)[:, :, :PARAMETERS]
