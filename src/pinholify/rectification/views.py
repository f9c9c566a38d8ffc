"""Views: ideal cameras at the virtual camera's centre, looking where one likes. One calibration, many views."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.arrays import Bools, Floats, frozen
from pinholify.camera import VirtualCamera
from pinholify.errors import CalibrationError, InputError
from pinholify.expansion import expand
from pinholify.geometry import homogeneous
from pinholify.rectification.rectangle import largest_rectangle
from pinholify.rectification.surfaces import Cylinder, Plane, Sphere, Surface
from pinholify.rectification.valid_region import believable, believable_directions

YawPitchRoll = tuple[float, float, float]
"""Yaw to the right, pitch upwards, roll clockwise: degrees, applied in this order."""

CUBE: dict[str, YawPitchRoll] = {
    "cube-front": (0.0, 0.0, 0.0),
    "cube-right": (90.0, 0.0, 0.0),
    "cube-back": (180.0, 0.0, 0.0),
    "cube-left": (-90.0, 0.0, 0.0),
    "cube-up": (0.0, 90.0, 0.0),
    "cube-down": (0.0, -90.0, 0.0),
}
SURFACES: dict[str, Surface] = {
    "camera": Plane(),
    "board": Plane(),
    "cylindrical": Cylinder(),
    "equirectangular": Sphere(),
}
VIEWS = (*SURFACES, *CUBE)
KEPT = ("all", "valid")
STRAIGHT_ON: YawPitchRoll = (0.0, 0.0, 0.0)
STEEPEST = np.deg2rad(65.0)  # how far from its axis, or from the horizon, a view shows all that is known
STEEPEST_CORNER = np.deg2rad(70.0)  # how far it goes for the sake of corners, where that takes in all of them
LOOKS_AWAY = "the view looks away from everything the camera sees; choose another view"
PROBE = 400  # px along the longer side of the small picture in which what is valid is looked for


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """An ideal camera: ``matrix`` (3, 3) px, ``rotation`` (3, 3) view from camera, ``size`` (width, height) px.

    ``matrix`` takes coordinates of ``surface`` to pixels; on the plane, the view is a pinhole camera and the matrix its
    K.
    """

    matrix: Floats
    rotation: Floats
    size: tuple[int, int]
    surface: Surface = field(default_factory=Plane)

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen(self.matrix, (3, 3)))
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3)))

    def directions(self, pixels: Floats) -> Floats:
        """Directions (n, 3) in the camera frame of the view's ``pixels`` (n, 2); nan where it shows none."""
        plane = homogeneous(pixels) @ np.linalg.inv(self.matrix).T
        return np.asarray(self.surface.directions(plane[:, :2]) @ self.rotation)

    def project(self, xyz: Floats) -> Floats:
        """Pixels of the view (n, 2) that show camera-frame points ``xyz`` (n, 3); nan behind a flat view."""
        q = self.surface.coordinates(xyz @ self.rotation.T)
        return np.asarray(homogeneous(q) @ self.matrix[:2].T)


def named_view(
    camera: VirtualCamera,
    name: str,
    size: tuple[int, int] | None,
    max_std: float | None,
    *,
    turn: YawPitchRoll = STRAIGHT_ON,
    fov: float | None = None,
    keep: str = "all",
) -> View:
    """The view a user calls ``name``; ``max_std`` as for :func:`believable`.

    ``camera`` looks along the optical axis and ``board`` straight at the reference board, both as pinhole cameras;
    ``cylindrical`` and ``equirectangular`` look along the axis and all around; ``cube-front``, ``-right``, ``-back``,
    ``-left``, ``-up`` and ``-down`` are the faces of a cube, 90° wide and square.

    ``turn`` turns it from there. ``fov`` is its horizontal field of view in degrees, around the middle of the picture;
    without it the view is fitted to what may be believed: ``keep`` ``all`` of that, as far as :func:`fitted_view` goes,
    or only ``valid`` pixels, the largest picture that has no black in it (OpenCV's alpha of 1 and 0). ``size``
    (width, height) px defaults to the image's. Raises InputError for what is no view, CalibrationError for one that
    shows nothing; but a cube is whole only with all its faces, black ones too.
    """
    if name not in VIEWS:
        raise InputError(f"'{name}' is no view; the views are: {', '.join(VIEWS)}")
    if keep not in KEPT:
        raise InputError(f"'{keep}' is nothing to keep; there are: {', '.join(KEPT)}")
    if fov is not None and keep != "all":
        raise InputError("a field of view and what to keep cannot both be asked for; give one of the two")
    if name in CUBE:
        return _cube_face(camera, name, size, turn, given=fov is not None or keep != "all")
    surface = SURFACES[name]
    rotation = _turned(np.eye(3) if name == "board" else optical_rotation(camera), turn)
    if fov is not None:
        view = view_of_width(rotation, size or camera.image_size, fov, surface)
        if shows_nothing(camera, view, max_std):
            raise CalibrationError(LOOKS_AWAY)
        return view
    view = fitted_view(camera, rotation, size, max_std, surface)
    return _without_black(camera, view, max_std) if keep == "valid" else view


def optical_rotation(camera: VirtualCamera) -> Floats:
    """The rotation (3, 3) to a frame that looks along the ray of the image's centre, level as the image is.

    Its y axis follows the image's columns downwards and x completes a right-handed frame, so the view of a camera that
    looks into a mirror shows the scene unreversed.
    """
    z, down = _optical_axis(camera)
    y = down - z * (down @ z)
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z])


def _optical_axis(camera: VirtualCamera) -> tuple[Floats, Floats]:
    """The direction (3,) in which the middle of the image looks, and how it changes by a px downwards (3,)."""
    width, height = camera.image_size
    centre = np.array([[(width - 1) / 2.0, (height - 1) / 2.0]])
    if not camera.inside(centre)[0]:
        centre = camera.domain.hull.vertices.mean(axis=0, keepdims=True)
    q = camera.plane_map.value(centre)
    down = (camera.chart.direction_jacobian(q) @ camera.plane_map.jacobian(centre))[0, :, 1]
    return camera.chart.directions(q)[0], down


def _turned(rotation: Floats, turn: YawPitchRoll) -> Floats:
    return np.asarray(Rotation.from_euler("YXZ", turn, degrees=True).as_matrix().T @ rotation)


def _cube_face(
    camera: VirtualCamera, name: str, size: tuple[int, int] | None, turn: YawPitchRoll, *, given: bool
) -> View:
    """A face; as fine as the middle of the image by default."""
    if given:
        raise InputError(f"the view '{name}' is the face of a cube, 90 degrees wide; leave out --fov and --keep")
    if size is None:
        side = max(1, round(2.0 / float(np.linalg.norm(_optical_axis(camera)[1]))))
        size = (side, side)
    if size[0] != size[1]:
        raise InputError(
            f"the view '{name}' is the face of a cube and {size[0]}x{size[1]} was asked for; give a square size"
        )
    return view_of_width(_turned(_turned(optical_rotation(camera), turn), CUBE[name]), size, 90.0, Plane())


def view_of_width(rotation: Floats, size: tuple[int, int], fov: float, surface: Surface) -> View:
    """The view along ``rotation`` that is ``fov`` degrees wide from outer edge to outer edge; raises InputError."""
    if not 0.0 < fov <= surface.widest_fov:
        raise InputError(
            f"a field of view of {fov:g} degrees was asked for where this view has more than 0 and at most "
            f"{surface.widest_fov:g}; for more, take the view 'cylindrical' or 'equirectangular'"
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
    """The view along ``rotation`` that shows all that may be believed within 65°, as large as it fits.

    That is from the view's axis or, all around, from the horizon: a picture grows without bound towards 90°. Where the
    calibration's corners end between 65° and 70°, it shows all that lies as far out as they do. ``size``
    (width, height) px defaults to the image's, ``surface`` is a plane. Raises CalibrationError where the view shows
    nothing.
    """
    surface = surface or Plane()
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
    directions = believable_directions(camera, max_std)
    if len(directions) < 4:
        raise CalibrationError(
            "nowhere in the image is the standard deviation within the camera's domain; allow more with --max-std"
            if max_std is None
            else f"nowhere in the image is the standard deviation at most {max_std} px; allow more with --max-std"
        )
    return directions


def _reach(camera: VirtualCamera, rotation: Floats, surface: Surface) -> float:
    """How steep a direction may be to be fitted into a view, radians."""
    corners = camera.chart.directions(camera.plane_map.value(camera.domain.hull.vertices)) @ rotation.T
    steepest = float(surface.steepness(corners).max())
    return steepest + 1e-9 if STEEPEST < steepest <= STEEPEST_CORNER else float(STEEPEST)


def share_outside(camera: VirtualCamera, view: View, max_std: float | None) -> float:
    """The share of what may be believed of the original image that ``view`` does not show."""
    seen = view.project(_known_directions(camera, max_std))
    # The view's border runs through its outermost pixels' outer edges.
    with np.errstate(invalid="ignore"):
        inside = ((seen >= -0.5) & (seen <= np.array(view.size) - 0.5)).all(axis=1)
    return 1.0 - float(inside.mean())


def _without_black(camera: VirtualCamera, view: View, max_std: float | None) -> View:
    """The largest part of ``view`` of its proportions in which everything is valid, at the same size."""
    width, height = view.size
    probe, valid = _probed(camera, view, max_std)
    found = largest_rectangle(valid, width / height)
    if found is None:
        raise CalibrationError("no part of this view is free of black pixels; keep all of it, or choose another view")
    scale = max((width - 1) / (found.right - found.left), (height - 1) / (found.bottom - found.top))
    middle = np.array([found.left + found.right, found.top + found.bottom]) / 2.0
    matrix = np.diag([scale, scale, 1.0]) @ probe.matrix
    matrix[:2, 2] += (np.array([width, height]) - 1) / 2.0 - scale * middle
    return View(matrix, view.rotation, view.size, view.surface)


def shows_nothing(camera: VirtualCamera, view: View, max_std: float | None) -> bool:
    """Whether ``view`` is black all over, as far as a small picture of it tells; ``max_std`` as for `believable`."""
    return not _probed(camera, view, max_std)[1].any()


def _probed(camera: VirtualCamera, view: View, max_std: float | None) -> tuple[View, Bools]:
    """A small picture of ``view``, and what is valid in it (height, width)."""
    probe = _resized(view, PROBE / max(view.size))
    uv = expand(lambda pixels: camera.project(probe.directions(pixels)), probe.size, tolerance=0.05)
    return probe, believable(camera, uv.reshape(2, -1).T, max_std).reshape(uv.shape[1:])


def _resized(view: View, scale: float) -> View:
    """The same view at another resolution; the outer corner of the picture stays."""
    resize = np.array([[scale, 0, (scale - 1) / 2.0], [0, scale, (scale - 1) / 2.0], [0, 0, 1]])
    width, height = (max(2, round(n * scale)) for n in view.size)
    return View(resize @ view.matrix, view.rotation, (width, height), view.surface)
