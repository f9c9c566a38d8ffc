"""Other programs' lens models, as their manuals define them: directions or points (n, 3) → pixels (n, 2).

Each function makes a projection from fx, fy, cx, cy (``core``) and the model's own parameters. Points that a model does
not see are nan. mrcal's are those of https://mrcal.secretsauce.net/lensmodels.html.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pinholify.arrays import Floats
from pinholify.io.importing.base import Projection
from pinholify.splines import SplineSurface


def brown(core: Floats, distortion: Floats) -> Projection:
    """OpenCV's model: 0, 4, 5, 8, 12 or 14 coefficients (plumb bob, rational, thin prism, tilt), for z > 0."""
    return _imaged(core, lambda xyz: distorted(_plane(xyz), distortion))


def fisheye(core: Floats, distortion: Floats) -> Projection:
    """OpenCV's fisheye, Kalibr's pinhole-equi and ROS's equidistant: θ(1 + k₁θ² + … + k₄θ⁸) (Kannala & Brandt 2006).

    The formula is also used beyond 90°, where those programs' own functions end.
    """

    def plane(xyz: Floats) -> Floats:
        theta = _angle(xyz)
        powers = theta[:, None] ** (2 * np.arange(len(distortion) + 1))
        return _along(xyz, theta * (powers @ np.append(1.0, distortion)))

    return _imaged(core, plane)


def field_of_view(core: Floats, width: float) -> Projection:
    """Kalibr's pinhole-fov: r = atan(2 tan θ tan(w/2))/w (Devernay & Faugeras 2001)."""

    def plane(xyz: Floats) -> Floats:
        radius = np.tan(_angle(xyz))
        return _along(xyz, np.where(xyz[:, 2] > 0, np.arctan(2.0 * radius * np.tan(width / 2.0)) / width, np.nan))

    return _imaged(core, plane)


def unified(core: Floats, xi: float, distortion: Floats) -> Projection:
    """Kalibr's omni: a unit sphere seen from ξ behind its centre (Mei & Rives 2007), then ``distortion``."""

    def plane(xyz: Floats) -> Floats:
        length = np.linalg.norm(xyz, axis=1)
        return distorted(_ratio(xyz, xyz[:, 2] + xi * length), distortion)

    return _imaged(core, plane)


def extended_unified(core: Floats, alpha: float, beta: float) -> Projection:
    """Kalibr's eucm (Khomutenko, Garcia & Martinet 2016)."""

    def plane(xyz: Floats) -> Floats:
        length = np.sqrt(beta * (xyz[:, :2] ** 2).sum(axis=1) + xyz[:, 2] ** 2)
        return _ratio(xyz, alpha * length + (1.0 - alpha) * xyz[:, 2])

    return _imaged(core, plane)


def double_sphere(core: Floats, xi: float, alpha: float) -> Projection:
    """Kalibr's ds (Usenko, Demmel & Cremers 2018)."""

    def plane(xyz: Floats) -> Floats:
        shifted = xyz[:, 2] + xi * np.linalg.norm(xyz, axis=1)
        length = np.sqrt((xyz[:, :2] ** 2).sum(axis=1) + shifted**2)
        return _ratio(xyz, alpha * length + (1.0 - alpha) * shifted)

    return _imaged(core, plane)


def stereographic(core: Floats) -> Projection:
    """mrcal's LENSMODEL_STEREOGRAPHIC: r = 2 tan(θ/2)."""
    return _imaged(core, stereographic_plane)


def stereographic_plane(xyz: Floats) -> Floats:
    """mrcal's u (n, 2): the direction away from the axis, as long as 2 tan(θ/2)."""
    return _ratio(xyz, (np.linalg.norm(xyz, axis=1) + xyz[:, 2]) / 2.0)


def splined_stereographic(core: Floats, surface: SplineSurface) -> Projection:
    """mrcal's LENSMODEL_SPLINED_STEREOGRAPHIC: u displaced by a ``surface`` over u."""

    def plane(xyz: Floats) -> Floats:
        u = stereographic_plane(xyz)
        return np.asarray(u + surface.value(u))

    return _imaged(core, plane)


def longitude_latitude(core: Floats) -> Projection:
    """mrcal's LENSMODEL_LONLAT: longitude about the y axis, latitude towards it."""
    return _imaged(core, lambda xyz: np.stack([_around(xyz[:, 0], xyz[:, 2]), _towards(xyz, 1)], axis=1))


def latitude_longitude(core: Floats) -> Projection:
    """mrcal's LENSMODEL_LATLON: latitude towards the x axis, longitude about it."""
    return _imaged(core, lambda xyz: np.stack([_towards(xyz, 0), _around(xyz[:, 1], xyz[:, 2])], axis=1))


def cahvor(core: Floats, numbers: Floats) -> Projection:
    """mrcal's LENSMODEL_CAHVOR: angles α, β of the axis o and r₀, r₁, r₂ (Yakimovsky & Cunningham 1978, Gennery 2001).

    p moves by μ(p − ω o), ω = p·o, μ = r₀ + r₁ τ + r₂ τ², τ = |p|²/ω² − 1.
    """
    (alpha, beta), radial = numbers[:2], numbers[2:]
    axis = np.array([np.sin(alpha) * np.cos(beta), np.sin(beta), np.cos(alpha) * np.cos(beta)])

    def plane(xyz: Floats) -> Floats:
        along = xyz @ axis
        tau = (xyz**2).sum(axis=1) / np.where(along > 0, along, np.nan) ** 2 - 1.0
        mu = np.polynomial.polynomial.polyval(tau, radial)
        return _plane(xyz + mu[:, None] * (xyz - along[:, None] * axis))

    return _imaged(core, plane)


# --- parts -------------------------------------------------------------------------------------------------------


def distorted(xy: Floats, distortion: ArrayLike) -> Floats:
    """Distort normalised points (n, 2) with OpenCV's ``distortion`` coefficients."""
    import cv2

    out = np.full_like(xy, np.nan)
    known = np.isfinite(xy).all(axis=1)
    if known.any():
        solid = np.column_stack([xy[known], np.ones(known.sum())])
        coefficients = np.asarray(distortion, dtype=np.float64)
        out[known] = cv2.projectPoints(solid, np.zeros(3), np.zeros(3), np.eye(3), coefficients)[0][:, 0]
    return out


def _imaged(core: Floats, plane: Projection) -> Projection:
    focal, centre = core[:2], core[2:]
    return lambda xyz: np.asarray(plane(xyz) * focal + centre)


def _ratio(xyz: Floats, depth: Floats) -> Floats:
    """(x, y) ÷ ``depth`` (n, 2), nan unless the depth is positive."""
    return np.asarray(xyz[:, :2] / np.where(depth > 0, depth, np.nan)[:, None])


def _plane(xyz: Floats) -> Floats:
    return _ratio(xyz, xyz[:, 2])


def _angle(xyz: Floats) -> Floats:
    """θ (n,) from the z axis."""
    return np.asarray(np.arctan2(np.hypot(xyz[:, 0], xyz[:, 1]), xyz[:, 2]))


def _along(xyz: Floats, radius: Floats) -> Floats:
    """Points (n, 2) in the directions of (x, y), at distances ``radius`` (n,) from the origin."""
    rho = np.hypot(xyz[:, 0], xyz[:, 1])
    return np.asarray(xyz[:, :2] * (radius / np.maximum(rho, 1e-300))[:, None])


def _around(sideways: Floats, forwards: Floats) -> Floats:
    return np.asarray(np.arctan2(sideways, forwards))


def _towards(xyz: Floats, axis: int) -> Floats:
    return np.asarray(np.arcsin(xyz[:, axis] / np.linalg.norm(xyz, axis=1)))
