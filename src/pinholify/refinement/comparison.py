"""Two cameras of the same image compared: how far apart their rays are, in px, once one is turned onto the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pinholify.arrays import Bools, Floats
from pinholify.camera import VirtualCamera
from pinholify.errors import InputError
from pinholify.geometry import cross_matrices, nearest_rotation, rotations_of
from pinholify.refinement.maps import JointMap

GRID = 40


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """The difference of two cameras on a grid of pixels.

    ``uv`` (n, 2) px, ``difference`` (n, 2) px: where the first camera's image has what the second sees at ``uv``,
    minus ``uv``; ``expected_std`` (n,) px per axis from both cameras' own uncertainty, after the best rotation too;
    ``covered`` (n,) whether both cameras are believed there; ``rotation`` (3, 3) takes the second's directions to the
    first's.
    """

    uv: Floats
    difference: Floats
    expected_std: Floats
    covered: Bools
    rotation: Floats

    def rms(self, *, everywhere: bool = False) -> float:
        """Root mean square length of the difference, px, where both are believed or ``everywhere`` that both see."""
        chosen = self.difference[np.isfinite(self.difference).all(axis=1) if everywhere else self.covered]
        return float(np.sqrt((chosen**2).sum(axis=1).mean())) if len(chosen) else float("nan")

    @property
    def expected_rms(self) -> float:
        """What :meth:`rms` would be of two calibrations of one unchanged camera, px."""
        chosen = self.expected_std[self.covered]
        return float(np.sqrt(2.0 * (chosen**2).mean())) if len(chosen) else float("nan")


def compare(first: VirtualCamera, second: VirtualCamera) -> Comparison:
    """How far the cameras' rays are apart over the image, after the best rotation where both are believed.

    The reference boards' frames are of no matter. Raises InputError for images of different size, or cameras that are
    believed nowhere together.
    """
    if first.image_size != second.image_size:
        raise InputError(
            f"the cameras are of {first.image_size[0]}x{first.image_size[1]} and {second.image_size[0]}x"
            f"{second.image_size[1]} px: compare cameras of images of the same size"
        )
    u, v = (np.linspace(0.0, extent - 1.0, GRID) for extent in first.image_size)
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    one, two = first.to_rays(uv), second.to_rays(uv)
    seen = np.isfinite(one.directions).all(axis=1) & np.isfinite(two.directions).all(axis=1)
    covered = seen & first.inside(uv) & second.inside(uv)
    if covered.sum() < 3:
        raise InputError("the cameras' covered areas do not overlap: photograph boards in the same part of the image")
    to_px = _pixels_per_direction(first, uv)
    rotation = _best_rotation(one.directions[covered], two.directions[covered], to_px[covered])
    apart = two.directions @ rotation.T - one.directions
    difference = np.einsum("nij,nj->ni", to_px, apart)
    expected = np.hypot(_own_std(first, uv, covered), _own_std(second, uv, covered))
    return Comparison(uv, difference, expected, covered, rotation)


def _own_std(camera: VirtualCamera, uv: Floats, covered: Bools) -> Floats:
    """Standard deviation (n,) px per axis of the camera's rays, the error that the best rotation takes up left out.

    Of a map that does not say how its errors hang together, all of it.
    """
    plane_map = camera.plane_map
    if not isinstance(plane_map, JointMap):
        return camera.to_rays(uv).std_px
    errors = np.linalg.solve(plane_map.jacobian(uv), plane_map.features(uv)) @ plane_map.root
    turns = _pixels_per_direction(camera, uv) @ cross_matrices(camera.to_rays(uv).directions)
    chosen = turns[covered].reshape(-1, 3)
    taken_up = np.linalg.lstsq(chosen, errors[covered].reshape(len(chosen), -1), rcond=None)[0]
    left = errors - turns @ taken_up
    return np.asarray(np.sqrt((left**2).sum(axis=(1, 2)) / 2.0))


def _pixels_per_direction(camera: VirtualCamera, uv: Floats) -> Floats:
    """∂uv/∂direction on the tangent plane, (n, 2, 3); nan where the camera sees nothing."""
    by_pixel = camera.chart.direction_jacobian(camera.plane_map.value(uv)) @ camera.plane_map.jacobian(uv)
    known = np.isfinite(by_pixel).all(axis=(1, 2))
    jacobian = np.full((len(uv), 2, 3), np.nan)
    jacobian[known] = np.linalg.pinv(by_pixel[known])
    return jacobian


def _best_rotation(target: Floats, source: Floats, to_px: Floats) -> Floats:
    """The rotation (3, 3) of ``source`` directions onto ``target`` that leaves the least squares in px."""
    start = nearest_rotation(target.T @ source)

    def residual(vector: Floats) -> Floats:
        turned = source @ (rotations_of(vector[None])[0] @ start).T
        return np.asarray(np.einsum("nij,nj->ni", to_px, turned - target).ravel())

    def jacobian(vector: Floats) -> Floats:
        turned = source @ (rotations_of(vector[None])[0] @ start).T
        return np.asarray(-(to_px @ cross_matrices(turned)).reshape(-1, 3))

    best = least_squares(residual, np.zeros(3), jac=jacobian, method="lm").x
    return np.asarray(rotations_of(best[None])[0] @ start)
