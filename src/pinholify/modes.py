"""The same camera in another mode of its sensor: cropped, binned, or at another resolution.

No new calibration is needed: a mode's pixel is a position on the calibrated sensor, and has the ray of that position.
K, the frame and the unit of length stay; standard deviations, noise and domain are in px of the mode.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Floats, frozen
from pinholify.camera import Domain, VirtualCamera
from pinholify.errors import InputError
from pinholify.geometry import ConvexRegion
from pinholify.gp.maps import Nearby, PlaneMap

ROUNDING_PX = 1.0  # tolerance of the size of an image that is scaled in proportion


@dataclass(frozen=True, slots=True, eq=False)
class SensorMode:
    """A :class:`pinholify.gp.maps.PlaneMap` of a mode's pixels: calibrated pixel = ``scale`` · pixel + ``offset``.

    ``scale`` (2,) and ``offset`` (2,) px are for u and v; ``plane_map`` is the map of the calibrated pixels.
    """

    plane_map: PlaneMap
    scale: Floats
    offset: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", frozen(self.scale, (2,)))
        object.__setattr__(self, "offset", frozen(self.offset, (2,)))

    def calibrated(self, uv: Floats) -> Floats:
        """Pixels (n, 2) of the calibrated image for the mode's ``uv`` (n, 2)."""
        return uv * self.scale + self.offset

    def restored(self, uv: Floats) -> Floats:
        """The mode's pixels (n, 2) for pixels ``uv`` (n, 2) of the calibrated image."""
        return (uv - self.offset) / self.scale

    def value(self, uv: Floats) -> Floats:
        """q (n, 2) of the mode's pixels ``uv`` (n, 2)."""
        return self.plane_map.value(self.calibrated(uv))

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv (n, 2, 2)."""
        return self.plane_map.jacobian(self.calibrated(uv)) * self.scale

    def covariance(self, uv: Floats) -> Floats:
        """Covariance (n, 2, 2) of q."""
        return self.plane_map.covariance(self.calibrated(uv))

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """Covariance (n, 2, 2) of q up to a rotation of the whole camera."""
        return self.plane_map.covariance_up_to_turn(self.calibrated(uv))

    def virtual_covariance(self, uv: Floats, by_q: Floats, by_k: Floats) -> Floats:
        """Covariance (n, 2, 2) of virtual points with the derivatives ``by_q`` (n, 2, 2) and ``by_k`` (n, 2, 3)."""
        return self.plane_map.virtual_covariance(self.calibrated(uv), by_q, by_k)

    def covariance_root(self, uv: Floats) -> Floats:
        """A root (n, 2, r) of the covariance of all q together; r = 0 where the calibrated map has none."""
        return self.plane_map.covariance_root(self.calibrated(uv))

    @property
    def disagreement(self) -> float:
        """That of the calibrated map."""
        return self.plane_map.disagreement

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """The mode's pixels (n, 2) of ``q`` (n, 2)."""

        def nearby_calibrated(q: Floats) -> tuple[Floats, float]:
            start, reach = nearby(q)
            return self.calibrated(start), reach * float(self.scale.max())

        return self.restored(self.plane_map.inverse(q, nearby_calibrated))

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Shifts (draws, n, 2) of q by random draws of the noise."""
        return self.plane_map.noise_response(self.calibrated(uv), draws, rng)


def cropped(camera: VirtualCamera, left: int, top: int, size: tuple[int, int]) -> VirtualCamera:
    """``camera`` when it reads only ``size`` (width, height) px from column ``left`` and row ``top`` on.

    Raises InputError if that is not inside its image.
    """
    width, height = camera.image_size
    fits = min(left, top) >= 0 and left + size[0] <= width and top + size[1] <= height
    if not fits or min(size) < 1:
        raise InputError(
            f"a crop of {size[0]}x{size[1]} from column {left} and row {top} is not inside the camera's image of "
            f"{width}x{height}; give one that is"
        )
    return _in_mode(camera, np.ones(2), np.array([left, top], dtype=np.float64), size)


def binned(camera: VirtualCamera, factor: int) -> VirtualCamera:
    """``camera`` when it reads ``factor`` × ``factor`` pixels as one; leftover columns and rows are not read.

    Raises InputError if the factor is below one or leaves no pixel.
    """
    width, height = camera.image_size
    if not 1 <= factor <= min(width, height):
        raise InputError(
            f"{factor}x{factor} binning of images of {width}x{height} was requested; "
            f"give an integer factor from 1 to {min(width, height)}"
        )
    return _in_mode(camera, np.full(2, float(factor)), np.zeros(2), (width // factor, height // factor))


def scaled(camera: VirtualCamera, size: tuple[int, int]) -> VirtualCamera:
    """``camera`` when its whole image is resampled to ``size`` (width, height) px, as image libraries resize.

    Raises InputError if ``size`` does not have the image's proportions, up to rounding: such images were also cropped,
    or come from another camera.
    """
    width, height = camera.image_size
    exact = min(abs(size[0] - size[1] * width / height), abs(size[1] - size[0] * height / width))
    if min(size) < 1 or exact > ROUNDING_PX:
        raise InputError(
            f"images of {size[0]}x{size[1]} do not have the proportions of the camera's {width}x{height}, so they are "
            "not just scaled; crop the camera first if its sensor was cropped, or calibrate at that size"
        )
    return _in_mode(camera, np.array([width / size[0], height / size[1]]), np.zeros(2), size)


def _in_mode(camera: VirtualCamera, scale: Floats, corner: Floats, size: tuple[int, int]) -> VirtualCamera:
    """``camera`` with pixels of ``scale`` (2,) px, and the outer corner of its image shifted by ``corner`` (2,) px."""
    # Scaling keeps the outer corner (-0.5, -0.5) of the image in place, not the centre of its first pixel.
    mode = SensorMode(camera.plane_map, scale, corner + (scale - 1.0) / 2.0)
    length = float(np.sqrt(scale.prod()))
    domain = Domain(ConvexRegion(mode.restored(camera.domain.hull.vertices)), camera.domain.max_std / length)
    return replace(
        camera, plane_map=_flat(mode), domain=domain, image_size=size, noise_px=camera.noise_px / length
    )


def _flat(mode: SensorMode) -> SensorMode:
    """``mode`` as a mode of the calibrated image itself, even if its map is that of another mode."""
    inner = mode.plane_map
    if not isinstance(inner, SensorMode):
        return mode
    return SensorMode(inner.plane_map, inner.scale * mode.scale, inner.calibrated(mode.offset))
