"""The interface of simulated lenses: pixels to rays, and points to pixels."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from pinholify.arrays import Floats


class LensRays(NamedTuple):
    """Rays in the camera frame (x right, y down, z forward): ``origins`` and unit ``directions``, (N, 3) each.

    Directions point from the camera into the scene; they are NaN where a pixel sees nothing.
    """

    origins: Floats
    directions: Floats


class Lens(Protocol):
    """An imaging system of any kind. Pixels: integer = pixel centre; lengths in squares of the board."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        ...

    @property
    def central(self) -> bool:
        """Whether all rays start at one point, the origin of the camera frame."""
        ...

    def unproject(self, uv: Floats) -> LensRays:
        """The rays that the pixels ``uv`` (N, 2) see."""
        ...

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3) of the camera frame; NaN where they cannot be imaged.

        The image plane is unbounded: pixels beyond ``size`` are not NaN.
        """
        ...


def unit(vectors: Floats) -> Floats:
    """``vectors`` (N, 3) scaled to length one."""
    x, y, z = vectors.T
    return np.asarray(vectors / np.sqrt(x**2 + y**2 + z**2)[:, None])


def central_rays(directions: Floats) -> LensRays:
    """Rays from the origin along ``directions`` (N, 3), which need not be of unit length."""
    return LensRays(np.broadcast_to(np.zeros(3), directions.shape), unit(directions))


def image_centre(size: tuple[int, int]) -> Floats:
    """The centre (2,) of an image of ``size`` (width, height), in px."""
    return (np.array(size, dtype=np.float64) - 1) / 2


def require_central(lens: Lens, what: str) -> None:
    """Raise ValueError if ``lens``, which is to be combined with ``what``, has no single centre."""
    if not lens.central:
        raise ValueError(f"{what} needs a lens with a single centre, but {type(lens).__name__} has none")
