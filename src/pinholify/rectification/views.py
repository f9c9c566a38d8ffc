"""Views: ideal pinhole cameras at the virtual camera's centre, looking where one likes. One calibration, many views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats, frozen
from pinholify.camera import VirtualCamera
from pinholify.errors import CalibrationError, InputError
from pinholify.geometry import homogeneous

VIEWS = ("camera", "board")
WIDEST = np.deg2rad(65.0)  # from the axis; a flat picture grows without bound towards 90°
SAMPLES = 96


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A pinhole view: ``matrix`` (3, 3) px, ``rotation`` (3, 3) view from camera, ``size`` (width, height) px."""

    matrix: Floats
    rotation: Floats
    size: tuple[int, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen(self.matrix, (3, 3)))
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3)))

    def directions(self, pixels: Floats) -> Floats:
        """Directions (n, 3) in the camera frame of the view's ``pixels`` (n, 2)."""
        return np.asarray(homogeneous(pixels) @ np.linalg.inv(self.matrix).T @ self.rotation)

    def project(self, xyz: Floats) -> Floats:
        """Pixels of the view (n, 2) that show camera-frame points ``xyz`` (n, 3); nan behind the view."""
        q = xyz @ self.rotation.T @ self.matrix.T
        return np.asarray(q[:, :2] / np.where(q[:, 2:] > 0, q[:, 2:], np.nan))


def named_view(camera: VirtualCamera, name: str, size: tuple[int, int] | None, max_std: float | None) -> View:
    """The view a user calls ``name``: ``camera`` or ``board``; ``max_std`` as for :func:`believable`."""
    if name == "board":
        return fitted_view(camera, np.eye(3), size, max_std)
    if name == "camera":
        return fitted_view(camera, optical_rotation(camera), size, max_std)
    raise InputError(f"'{name}' is no view; the views are: {', '.join(VIEWS)}")


def optical_rotation(camera: VirtualCamera) -> Floats:
    """The rotation (3, 3) to a frame that looks along the ray of the image's centre, level as the image is.

    Its y axis follows the image's columns downwards and x completes a right-handed frame, so the view of a camera that
    looks into a mirror shows the scene unreversed.
    """
    width, height = camera.image_size
    centre = np.array([[(width - 1) / 2.0, (height - 1) / 2.0]])
    if not camera.inside(centre)[0]:
        centre = camera.domain.hull.vertices.mean(axis=0, keepdims=True)
    q = camera.plane_map.value(centre)
    z = camera.chart.directions(q)[0]
    down = (camera.chart.direction_jacobian(q) @ camera.plane_map.jacobian(centre))[0, :, 1]
    y = down - z * (down @ z)
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z])


def fitted_view(
    camera: VirtualCamera, rotation: Floats, size: tuple[int, int] | None, max_std: float | None
) -> View:
    """The view along ``rotation`` that shows all that may be believed, up to 65° from its axis, as large as it fits.

    ``size`` (width, height) px defaults to the image's. Raises CalibrationError where the view shows nothing.
    """
    width, height = size or camera.image_size
    pixels = image_samples(camera.image_size)
    pixels = pixels[believable(camera, pixels, max_std)]
    if len(pixels) < 4:
        raise CalibrationError(
            f"nowhere in the image is the standard deviation at most {max_std} px; allow more with --max-std"
        )
    seen = camera.to_rays(pixels).directions @ rotation.T
    seen = seen[seen[:, 2] > np.cos(WIDEST)]
    if len(seen) < 4:
        raise CalibrationError("the view looks away from everything the camera sees; choose another view")
    flat = seen[:, :2] / seen[:, 2:]
    low, high = flat.min(axis=0), flat.max(axis=0)
    focal = float(((np.array([width, height]) - 1) / (high - low)).min())
    centre = (np.array([width, height]) - 1) / 2.0 - focal * (low + high) / 2.0
    return View(np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]]), rotation, (width, height))


def believable(camera: VirtualCamera, pixels: Floats, max_std: float | None) -> Bools:
    """Where ``pixels`` (n, 2) may be used: a standard deviation of at most ``max_std`` px, or inside the domain."""
    if max_std is None:
        return camera.inside(pixels)
    return np.asarray(camera.shape_std(pixels) <= max_std)


def image_samples(image_size: tuple[int, int]) -> Floats:
    """A grid of pixels over the whole image, its border included: (96², 2)."""
    u, v = (np.linspace(0.0, n - 1.0, SAMPLES) for n in image_size)
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
