"""The virtual camera: pixels ↔ virtual plane ↔ rays, with standard deviations, and the domain in which it is valid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, wraps
from typing import TYPE_CHECKING

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.charts import Chart, Intrinsics
from pinholify.errors import InputError
from pinholify.geometry import FARTHEST, ConvexRegion, image_grid, inverse_2x2

if TYPE_CHECKING:  # SciPy takes longer to load than all the rest of mapping pixels to rays
    from scipy.spatial import cKDTree

    from pinholify.gp.maps import PlaneMap

START_GRID = 48  # pixels along each side from which inversions start


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """Points (n, 2) and their covariance (n, 2, 2), due to the map alone: the noise of a new corner is not included."""

    points: Floats
    covariance: Floats

    @property
    def std(self) -> Floats:
        """Standard deviations along both axes, (n, 2); nan where a variance is lost in rounding."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Rays of pixels in the camera frame of the reference board.

    ``origins`` (n, 3) in squares, all zero because the camera has a single centre; ``directions`` (n, 3) unit vectors;
    ``std_px`` (n,) root mean square over both axes of the map's standard deviation, in px of the image.
    """

    origins: Floats
    directions: Floats
    std_px: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Domain:
    """Where a camera is valid: inside ``hull`` (px), where its ``shape_std`` is at most ``max_std`` px."""

    hull: ConvexRegion
    max_std: float = np.inf


def _of_pixels(method: Callable[[VirtualCamera, Floats], Floats]) -> Callable[[VirtualCamera, Floats], Floats]:
    """``method`` of pixels (n, 2), with nan for pixels that are not finite and for results that are not."""

    @wraps(method)
    def safe(camera: VirtualCamera, uv: Floats) -> Floats:
        known = np.isfinite(uv).all(axis=1)
        with np.errstate(all="ignore"):  # far outside the image a map may overflow
            found = method(camera, uv[known])
        answer = np.full((len(uv), *found.shape[1:]), np.nan)
        answer[known] = np.where(np.isfinite(found), found, np.nan)
        return answer

    return safe


@dataclass(frozen=True, slots=True, eq=False)
class VirtualCamera:
    """An ideal pinhole camera behind a learnt map of its image.

    ``plane_map`` maps pixels to chart coordinates; ``chart`` maps those to rays, and holds K. The frame is the
    reference board's: the optical centre is the origin, z is perpendicular to that board, and its plane is the virtual
    plane at z = f squares. ``image_size`` is (width, height) px; ``mirrored`` is whether the image is a reflection;
    ``noise_px`` is the fitted standard deviation per axis of the position of a corner of weight one, the only number
    that depends on the unit of the weights. Pixels and points that are not finite give nan.
    """

    plane_map: PlaneMap
    chart: Chart
    domain: Domain
    image_size: tuple[int, int]
    noise_px: float
    mirrored: bool = False

    @property
    def intrinsics(self) -> Intrinsics:
        """K of the virtual plane."""
        return self.chart.intrinsics

    # --- from pixels ---

    def to_rays(self, uv: Floats) -> Rays:
        """The :class:`Rays` of pixels ``uv`` (n, 2)."""
        directions = self._directions(uv)
        return Rays(np.zeros_like(directions), directions, _rms_std(self._ray_covariance(uv)))

    def to_virtual(self, uv: Floats) -> Mapped:
        """Virtual points of pixels ``uv`` (n, 2), in squares; nan for rays at 90° from the axis and beyond."""
        return Mapped(self.virtual_points(uv), self._virtual_covariance(uv))

    def virtual_points(self, uv: Floats) -> Floats:
        """Virtual points alone (n, 2), in squares: :meth:`to_virtual` without the covariance."""
        return self.intrinsics.project(self._directions(uv))

    @_of_pixels
    def virtual_jacobian(self, uv: Floats) -> Floats:
        """∂ virtual point/∂uv, (n, 2, 2) squares per px."""
        return np.asarray(self._virtual_by_chart(self.plane_map.value(uv)) @ self.plane_map.jacobian(uv))

    @_of_pixels
    def pixel_covariance(self, uv: Floats) -> Floats:
        """Covariance (n, 2, 2) of the map, converted to a shift of the pixel, in px²."""
        return self._as_pixels(uv, self.plane_map.covariance(uv))

    @_of_pixels
    def _directions(self, uv: Floats) -> Floats:
        """Unit directions (n, 3) of the rays of pixels ``uv`` (n, 2)."""
        return self.chart.directions(self.plane_map.value(uv))

    @_of_pixels
    def _virtual_covariance(self, uv: Floats) -> Floats:
        """Covariance (n, 2, 2) of virtual points, in squares²."""
        q = self.plane_map.value(uv)
        by_k = self.intrinsics.parameter_jacobian(self.chart.directions(q))
        return self.plane_map.virtual_covariance(uv, self._virtual_by_chart(q), by_k)

    def _virtual_by_chart(self, q: Floats) -> Floats:
        """∂ virtual point/∂ ``q`` (n, 2): (n, 2, 2)."""
        by_direction = self.intrinsics.projection_jacobian(self.chart.directions(q))
        return np.asarray(by_direction @ self.chart.direction_jacobian(q))

    @_of_pixels
    def _ray_covariance(self, uv: Floats) -> Floats:
        """Covariance (n, 2, 2) in px², due to the map and K together, of the pixel that sees a ray."""
        both = self.plane_map.covariance(uv) + self.chart.covariance(self.plane_map.value(uv))
        return self._as_pixels(uv, both)

    @_of_pixels
    def shape_std(self, uv: Floats) -> Floats:
        """Standard deviation (n,) of the map's shape at ``uv`` (n, 2), in px, root mean square over both axes.

        It excludes what a rotation of the whole camera could undo, such as the uncertainty of the reference board's
        pose.
        """
        return _rms_std(self._as_pixels(uv, self.plane_map.covariance_up_to_turn(uv)))

    def _as_pixels(self, uv: Floats, covariance: Floats) -> Floats:
        inverse = inverse_2x2(self.plane_map.jacobian(uv))
        return np.asarray(inverse @ covariance @ inverse.transpose(0, 2, 1))

    def inside(self, uv: Floats) -> Bools:
        """Which (n,) of the pixels ``uv`` (n, 2) lie in the domain."""
        inside = self.domain.hull.contains(uv)
        if np.isfinite(self.domain.max_std) and inside.any():
            inside[inside] = self.shape_std(uv[inside]) <= self.domain.max_std
        return inside

    # --- to pixels ---

    def from_virtual(self, xy: Floats) -> Mapped:
        """Pixels (n, 2) that see virtual points ``xy`` (n, 2) in squares; nan where the inverse does not converge."""
        return self.from_rays(self.intrinsics.directions(xy))

    def from_rays(self, xyz: Floats) -> Mapped:
        """Pixels (n, 2) that see points or directions ``xyz`` (n, 3); nan where none do."""
        uv = self.project(xyz)
        covariance = np.full((len(uv), 2, 2), np.nan)
        found = np.isfinite(uv).all(axis=1)
        covariance[found] = self._ray_covariance(uv[found])
        return Mapped(uv, covariance)

    def project(self, xyz: Floats) -> Floats:
        """Pixels (n, 2) of points ``xyz`` (n, 3) of the camera frame: :meth:`from_rays` without the covariance."""
        q = self.chart.coordinates(np.where(np.isfinite(xyz).all(axis=1, keepdims=True), xyz, np.nan))
        uv = np.full((len(xyz), 2), np.nan)
        known = (np.abs(q) < FARTHEST).all(axis=1)
        if known.any():
            uv[known] = invert(self, q[known])
        return uv


def _rms_std(covariance: Floats) -> Floats:
    """The root mean square (n,) over both axes of standard deviations; nan where a variance is lost in rounding."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 2.0))


def virtual(camera: object) -> VirtualCamera:
    """``camera`` itself; raises InputError if it is something else, such as the calibration that holds it."""
    if not isinstance(camera, VirtualCamera):
        raise InputError(
            f"a {type(camera).__name__} was given where a VirtualCamera is needed; give the .camera of the result of "
            "read_camera or calibrate"
        )
    return camera


def invert(camera: VirtualCamera, q: Floats) -> Floats:
    """Pixels (n, 2) that ``camera``'s map takes to ``q`` (n, 2); nan where the inverse does not converge.

    A pixel farther outside the image than the image's own size counts as not converged.
    """
    uv = camera.plane_map.inverse(q, lambda q: _nearby(camera, q))
    far = np.abs(uv / camera.image_size - 0.5).max(axis=1, initial=0.0, keepdims=True) >= 1.5
    return np.asarray(np.where(far, np.nan, uv))


def _nearby(camera: VirtualCamera, q: Floats) -> tuple[Floats, float]:
    """The pixels of the start grid whose map values are nearest to ``q``, and the longest useful step."""
    grid, at_grid, reach = _start_grid(camera)
    return grid[at_grid.query(q)[1]], reach


@lru_cache(maxsize=8)
def _start_grid(camera: VirtualCamera) -> tuple[Floats, cKDTree, float]:
    """Pixels (n, 2) to start from, the tree of their map values, and the longest useful step in px.

    Only pixels where the map has the same handedness as inside the domain's hull are used.
    """
    from scipy.spatial import cKDTree

    hull = camera.domain.hull
    regular = image_grid(camera.image_size, START_GRID)
    grid = np.concatenate([regular, hull.vertices, hull.vertices.mean(axis=0, keepdims=True)])
    with np.errstate(invalid="ignore"):  # a map may be nan in places
        handedness = np.sign(np.linalg.det(camera.plane_map.jacobian(grid)))
    keep = handedness == np.sign(handedness[hull.contains(grid)].sum())
    grid = grid[keep]
    return grid, cKDTree(camera.plane_map.value(grid)), 2.0 * float(regular[START_GRID + 1].max())
