"""The comparison of two cameras: the differences of their rays, in px, after the best rotation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pinholify.arrays import Bools, Floats
from pinholify.camera import VirtualCamera
from pinholify.errors import InputError
from pinholify.geometry import cross_matrices, image_grid, inverse_2x2, nearest_rotation

GRID = 40  # pixels along each side of the image


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """The difference of two cameras on a grid of pixels.

    ``uv`` (n, 2) are the pixels, ``difference`` (n, 2) px is where the first camera's image has what the second sees at
    ``uv``, minus ``uv``. ``expected_std`` (n,) px per axis is due to both cameras' own uncertainty, after the best
    rotation too. ``covered`` (n,) marks the pixels in the domains of both cameras. ``rotation`` (3, 3) takes the
    second's directions to the first's.
    """

    uv: Floats
    difference: Floats
    expected_std: Floats
    covered: Bools
    rotation: Floats

    def rms(self, *, everywhere: bool = False) -> float:
        """RMS length of the difference, px, in the domains of both cameras or ``everywhere`` that both have rays."""
        chosen = self.difference[np.isfinite(self.difference).all(axis=1) if everywhere else self.covered]
        return float(np.sqrt((chosen**2).sum(axis=1).mean())) if len(chosen) else float("nan")

    @property
    def expected_rms(self) -> float:
        """The :meth:`rms`, px, that is expected of two calibrations of one unchanged camera."""
        chosen = self.expected_std[self.covered]
        return float(np.sqrt(2.0 * (chosen**2).mean())) if len(chosen) else float("nan")


def compare(first: VirtualCamera, second: VirtualCamera) -> Comparison:
    """The differences of the cameras' rays over the image, after the best rotation in the domains of both.

    The frames of the reference boards do not matter. Raises InputError for images of different size, or domains that do
    not overlap.
    """
    if first.image_size != second.image_size:
        raise InputError(
            f"the cameras are for images of {first.image_size[0]}x{first.image_size[1]} and {second.image_size[0]}x"
            f"{second.image_size[1]} px: compare cameras for images of the same size"
        )
    uv = image_grid(first.image_size, GRID)
    one, two = first.to_rays(uv), second.to_rays(uv)
    seen = np.isfinite(one.directions).all(axis=1) & np.isfinite(two.directions).all(axis=1)
    covered = seen & first.inside(uv) & second.inside(uv)
    if covered.sum() < 3:
        raise InputError("the cameras' covered areas do not overlap: photograph boards in the same part of the image")
    to_px = _pixels_per_direction(first, uv)
    rotation = _best_rotation(one.directions[covered], two.directions[covered], to_px[covered])
    difference = np.einsum("nij,nj->ni", to_px, two.directions @ rotation.T - one.directions)
    expected = np.hypot(_own_std(first, uv, covered), _own_std(second, uv, covered))
    return Comparison(uv, difference, expected, covered, rotation)


def _own_std(camera: VirtualCamera, uv: Floats, covered: Bools) -> Floats:
    """Standard deviation (n,) px per axis of the camera's rays, without the error that the best rotation absorbs.

    For a map that does not give the correlations of its errors, it is all of the error.
    """
    root = camera.plane_map.covariance_root(uv)
    if not root.shape[2]:
        return camera.to_rays(uv).std_px
    errors = inverse_2x2(camera.plane_map.jacobian(uv)) @ root
    turns = _pixels_per_direction(camera, uv) @ cross_matrices(camera.to_rays(uv).directions)
    chosen = turns[covered].reshape(-1, 3)
    taken_up = np.linalg.lstsq(chosen, errors[covered].reshape(len(chosen), -1), rcond=None)[0]
    left = errors - turns @ taken_up
    return np.asarray(np.sqrt((left**2).sum(axis=(1, 2)) / 2.0))


def _pixels_per_direction(camera: VirtualCamera, uv: Floats) -> Floats:
    """∂uv/∂direction (n, 2, 3) on the tangent plane, at ``uv`` (n, 2); nan where the camera has no ray."""
    by_pixel = camera.chart.direction_jacobian(camera.plane_map.value(uv)) @ camera.plane_map.jacobian(uv)
    known = np.isfinite(by_pixel).all(axis=(1, 2))
    jacobian = np.full((len(uv), 2, 3), np.nan)
    jacobian[known] = np.linalg.pinv(by_pixel[known])
    return jacobian


def _best_rotation(target: Floats, source: Floats, to_px: Floats) -> Floats:
    """The rotation (3, 3) of ``source`` directions (n, 3) onto ``target`` (n, 3) of least squared differences in px."""
    start = nearest_rotation(target.T @ source)

    def residual(vector: Floats) -> Floats:
        turned = source @ (Rotation.from_rotvec(vector).as_matrix() @ start).T
        return np.asarray(np.einsum("nij,nj->ni", to_px, turned - target).ravel())

    def jacobian(vector: Floats) -> Floats:
        turned = source @ (Rotation.from_rotvec(vector).as_matrix() @ start).T
        return np.asarray(-(to_px @ cross_matrices(turned)).reshape(-1, 3))

    best = least_squares(residual, np.zeros(3), jac=jacobian, method="lm").x
    return np.asarray(Rotation.from_rotvec(best).as_matrix() @ start)
