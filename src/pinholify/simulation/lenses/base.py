"""What a simulated lens is: pixels to rays of light, and points of space to pixels."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from pinholify.arrays import Floats


class Rays(NamedTuple):
    """Half lines in the camera frame (x right, y down, z forward): ``origins`` and ``directions``, (N, 3).

    The unit direction leads away from the camera into the scene; it is NaN where a pixel sees nothing.
    """

    origins: Floats
    directions: Floats


class Lens(Protocol):
    """An imaging system of any kind. Pixels: integer = centre of a pixel; lengths in squares of the board."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        ...

    @property
    def central(self) -> bool:
        """Whether all rays start at one point, the origin of the camera frame."""
        ...

    def unproject(self, uv: Floats) -> Rays:
        """The rays that the pixels ``uv`` (N, 2) see."""
        ...

    def project(self, points: Floats) -> Floats:
        """Where ``points`` (N, 3) of the camera frame appear: (N, 2) px, NaN where they cannot be imaged.

        The image plane is thought without end: a pixel beyond ``size`` is a number and not NaN.
        """
        ...


def unit(vectors: Floats) -> Floats:
    """``vectors`` (N, 3) scaled to length one."""
    x, y, z = vectors.T
    return np.asarray(vectors / np.sqrt(x**2 + y**2 + z**2)[:, None])


def central_rays(directions: Floats) -> Rays:
    """Rays from the origin along ``directions`` (N, 3), which need not be of unit length."""
    return Rays(np.broadcast_to(np.zeros(3), directions.shape), unit(directions))


def image_centre(size: tuple[int, int]) -> Floats:
    """The middle of an image of ``size`` (width, height): (2,) px."""
    return (np.array(size, dtype=np.float64) - 1) / 2


def require_central(lens: Lens, what: str) -> None:
    """Raises ValueError where ``what`` is put before a lens without a centre."""
    if not lens.central:
        raise ValueError(f"{what} needs a lens with a single centre, {type(lens).__name__} has none")
