"""Views: ideal cameras at the virtual camera's centre, in any orientation. One calibration gives many views."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.arrays import Bools, Floats, frozen
from pinholify.camera import VirtualCamera
from pinholify.errors import CalibrationError, InputError
from pinholify.expansion import expand
from pinholify.geometry import homogeneous
from pinholify.rectification.options import DEFAULT_VIEW, VIEWS, ViewOptions, YawPitchRoll
from pinholify.rectification.rectangle import largest_rectangle
from pinholify.rectification.surfaces import SURFACES, FlatSurface, Surface
from pinholify.rectification.valid_region import valid_directions, valid_pixels

MAX_STEEPNESS_RAD = np.deg2rad(65.0)
"""From a fitted view's axis, or from the horizon: up to there it shows all valid pixels."""

MAX_CORNER_STEEPNESS_RAD = np.deg2rad(70.0)
"""Up to which a fitted view is extended if that includes all corners of the calibration."""

LOOKS_AWAY = "the view looks away from everything the camera sees; choose another view"
PROBE_PX = 400  # longer side of the small image in which the valid part of a view is determined


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """An ideal camera: ``matrix`` (3, 3) px, ``rotation`` (3, 3) view_from_camera, ``size`` (width, height) px.

    ``matrix`` maps coordinates of ``surface`` to pixels. With a plane the view is a pinhole camera with this K.
    """

    matrix: Floats
    rotation: Floats
    size: tuple[int, int]
    surface: Surface = field(default_factory=FlatSurface)

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen(self.matrix, (3, 3)))
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3)))

    def directions(self, pixels: Floats) -> Floats:
        """Directions (n, 3) in the camera frame of the view's ``pixels`` (n, 2); nan beyond the surface's end."""
        plane = homogeneous(pixels) @ np.linalg.inv(self.matrix).T
        return np.asarray(self.surface.directions(plane[:, :2]) @ self.rotation)

    def project(self, xyz: Floats) -> Floats:
        """Pixels of the view (n, 2) that show camera-frame points ``xyz`` (n, 3); nan behind a flat view."""
        q = self.surface.coordinates(xyz @ self.rotation.T)
        return np.asarray(homogeneous(q) @ self.matrix[:2].T)


def named_view(camera: VirtualCamera, options: ViewOptions = DEFAULT_VIEW) -> View:
    """The view of ``camera`` that ``options`` describe.

    Raises InputError for an impossible field of view, CalibrationError for a view that shows nothing. Faces of a cube
    may be black, because a cube needs all six.
    """
    kind = VIEWS[options.name]
    if kind.face is not None:
        return _cube_face(camera, options, kind.face)
    surface = SURFACES[kind.surface]
    rotation = _turned(np.eye(3) if options.name == "board" else optical_rotation(camera), options.turn)
    if options.fov is not None:
        view = view_of_width(rotation, options.size or camera.image_size, options.fov, surface)
        if shows_nothing(camera, view, options.max_std):
            raise CalibrationError(LOOKS_AWAY)
        return view
    view = fitted_view(camera, rotation, options.size, options.max_std, surface)
    return _without_black(camera, view, options.max_std) if options.keep == "valid" else view


def optical_rotation(camera: VirtualCamera) -> Floats:
    """The rotation (3, 3) from the camera frame to one that looks along the ray of the image's centre.

    Its y axis follows the image's columns downwards and x completes a right-handed frame, so the view of a camera that
    looks into a mirror shows the scene unreversed.
    """
    z, down = _optical_axis(camera)
    y = down - z * (down @ z)
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z])


def _optical_axis(camera: VirtualCamera) -> tuple[Floats, Floats]:
    """The unit direction (3,) of the image's centre, and its derivative (3,) per px downwards."""
    width, height = camera.image_size
    centre = np.array([[(width - 1) / 2.0, (height - 1) / 2.0]])
    if not camera.inside(centre)[0]:
        centre = camera.domain.hull.vertices.mean(axis=0, keepdims=True)
    q = camera.plane_map.value(centre)
    down = (camera.chart.direction_jacobian(q) @ camera.plane_map.jacobian(centre))[0, :, 1]
    return camera.chart.directions(q)[0], down


def _turned(rotation: Floats, turn: YawPitchRoll) -> Floats:
    return np.asarray(Rotation.from_euler("YXZ", turn, degrees=True).as_matrix().T @ rotation)


def _cube_face(camera: VirtualCamera, options: ViewOptions, face: YawPitchRoll) -> View:
    """A face of a cube; without a size it has the resolution of the image's centre."""
    side = max(1, round(2.0 / float(np.linalg.norm(_optical_axis(camera)[1]))))
    rotation = _turned(_turned(optical_rotation(camera), options.turn), face)
    return view_of_width(rotation, options.size or (side, side), 90.0, FlatSurface())


def view_of_width(rotation: Floats, size: tuple[int, int], fov: float, surface: Surface) -> View:
    """The view with ``rotation`` that is ``fov`` degrees wide between its outer edges; raises InputError."""
    if not 0.0 < fov <= surface.widest_fov:
        raise InputError(
            f"a field of view of {fov:g} degrees was requested, but this view must have more than 0 and at most "
            f"{surface.widest_fov:g}; for more, use the view 'cylindrical' or 'equirectangular'"
        )
    focal = size[0] / surface.width(float(np.deg2rad(fov)))
    matrix = np.array([[focal, 0, (size[0] - 1) / 2.0], [0, focal, (size[1] - 1) / 2.0], [0, 0, 1]])
    return View(matrix, rotation, size, surface)


def fitted_view(
    camera: VirtualCamera,
    rotation: Floats,
    size: tuple[int, int] | None,
    max_std: float | None,
    surface: Surface | None = None,
) -> View:
    """The view with ``rotation`` that shows all valid pixels within 65°, at the largest scale that fits.

    The angle is measured from the view's axis, on a cylinder from the horizon: images grow without bound towards 90°.
    If the outermost of the calibration's corners lie between 65° and 70°, their angle is the limit. ``size``
    (width, height) px defaults to the image's, ``surface`` to a plane. Raises CalibrationError if the view shows
    nothing.
    """
    surface = surface or FlatSurface()
    width, height = size or camera.image_size
    seen = _known_directions(camera, max_std) @ rotation.T
    seen = seen[surface.steepness(seen) <= _reach(camera, rotation, surface)]
    if len(seen) < 4:
        raise CalibrationError(LOOKS_AWAY)
    flat = surface.coordinates(seen)
    low, high = flat.min(axis=0), flat.max(axis=0)
    focal = float(((np.array([width, height]) - 1) / (high - low)).min())
    centre = (np.array([width, height]) - 1) / 2.0 - focal * (low + high) / 2.0
    matrix = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    return View(matrix, rotation, (width, height), surface)


def _known_directions(camera: VirtualCamera, max_std: float | None) -> Floats:
    directions = valid_directions(camera, max_std)
    if len(directions) < 4:
        limit = "within the camera's domain" if max_std is None else f"at most {max_std} px"
        raise CalibrationError(f"nowhere in the image is the standard deviation {limit}; allow a larger one (max-std)")
    return directions


def _reach(camera: VirtualCamera, rotation: Floats, surface: Surface) -> float:
    """The largest steepness, in radians, of directions that a view is fitted to."""
    corners = camera.chart.directions(camera.plane_map.value(camera.domain.hull.vertices)) @ rotation.T
    steepest = float(surface.steepness(corners).max())
    return steepest + 1e-9 if MAX_STEEPNESS_RAD < steepest <= MAX_CORNER_STEEPNESS_RAD else float(MAX_STEEPNESS_RAD)


def share_outside(camera: VirtualCamera, view: View, max_std: float | None) -> float:
    """The share of the original image's valid pixels that ``view`` does not show."""
    seen = view.project(_known_directions(camera, max_std))
    # The view's border is the outer edge of its outermost pixels.
    with np.errstate(invalid="ignore"):
        inside = ((seen >= -0.5) & (seen <= np.array(view.size) - 0.5)).all(axis=1)
    return 1.0 - float(inside.mean())


def _without_black(camera: VirtualCamera, view: View, max_std: float | None) -> View:
    """The largest all-valid part of ``view`` of the same proportions, at the same size."""
    width, height = view.size
    probe, valid = _probed(camera, view, max_std)
    found = largest_rectangle(valid, width / height)
    if found is None:
        raise CalibrationError("no part of this view is free of black pixels; keep all of it, or choose another view")
    scale = max((width - 1) / (found.right - found.left), (height - 1) / (found.bottom - found.top))
    middle = np.array([found.left + found.right, found.top + found.bottom]) / 2.0
    matrix = np.diag([scale, scale, 1.0]) @ probe.matrix
    matrix[:2, 2] += (np.array([width, height]) - 1) / 2.0 - scale * middle
    return replace(view, matrix=matrix)


def shows_nothing(camera: VirtualCamera, view: View, max_std: float | None) -> bool:
    """Whether ``view`` is all black, judged by a small image of it; ``max_std`` as for :func:`source_mask`."""
    return not _probed(camera, view, max_std)[1].any()


def _probed(camera: VirtualCamera, view: View, max_std: float | None) -> tuple[View, Bools]:
    """A small version of ``view``, and the mask (height, width) of its valid pixels."""
    probe = _resized(view, PROBE_PX / max(view.size))
    uv = expand(lambda pixels: camera.project(probe.directions(pixels)), probe.size, tolerance=0.05)
    return probe, valid_pixels(camera, uv.reshape(2, -1).T, max_std).reshape(uv.shape[1:])


def _resized(view: View, scale: float) -> View:
    """The same view at another resolution; the outer corner of its image stays in place."""
    resize = np.array([[scale, 0, (scale - 1) / 2.0], [0, scale, (scale - 1) / 2.0], [0, 0, 1]])
    width, height = (max(2, round(n * scale)) for n in view.size)
    return replace(view, matrix=resize @ view.matrix, size=(width, height))
