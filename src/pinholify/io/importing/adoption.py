"""Conversion of another program's camera: the map from its pixels to rays, represented by a spline.

Every lens model is treated in the same way: its projection is inverted numerically where it is one to one, from the
axis outwards, and the spline is refined until it reproduces the lens.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Bools, Floats
from pinholify.board import Board, Checkerboard
from pinholify.calibration.result import IMPORTED, Calibration
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import AngleChart, Intrinsics, angles_to_directions
from pinholify.corners import CornerSet
from pinholify.errors import CalibrationError
from pinholify.geometry import ConvexRegion, convex_hull
from pinholify.gp.maps import newton_inverse
from pinholify.io.importing.base import ForeignCamera
from pinholify.splines import SplineMap, SplineSurface, fitted, worst_places

TOLERANCE = 1e-3  # px; largest error of the spline below which no finer one is tried
WORST = 0.05
"""px; error above which the spline does not reproduce the lens, because the lens is about to fold or end."""

CELLS = (16, 32, 64, 128)
"""Numbers of spline cells along the longer side of the image, tried in this order."""

SAMPLES = 2  # per cell and axis, for the fit
MARGIN = 0.06
"""As a fraction of the image's longer side: how far the spline extends beyond the image if the lens does too.

Piecewise expansions of the map need a margin beyond the border.
"""

MAX_ANGLE_RAD = np.deg2rad(172.0)  # from the axis; straight behind, the azimuth is undefined
MIN_ANGLE_RAD = 1e-4  # radians
AZIMUTHS, ANGLES = 120, 250
MAX_STRETCH_RATIO = 12.0  # ratio of the stretches along both axes, beyond which a pole of the projection is near
STEP = 1e-6  # radians, to differentiate a projection
MIN_COVERED_SHARE = 0.01  # of the image; below, the parameters are hardly those of a lens

UNKNOWN_BOARD = Checkerboard(3, 3)
"""Placeholder for the board of a camera that was imported without one."""


@dataclass(frozen=True, slots=True, eq=False)
class Adopted:
    """The converted camera, and the fit errors inside its domain: ``rms_px`` and ``largest_px``, per point.

    ``covered`` is the share of the image in which the lens model is defined; ``knots`` are the numbers of control
    points of the spline across and down.
    """

    calibration: Calibration
    rms_px: float
    largest_px: float
    covered: float
    knots: tuple[int, int]


def adopt(theirs: ForeignCamera, *, board: Board | None = None, square_mm: float | None = None) -> Adopted:
    """Convert ``theirs`` to a virtual camera in its own frame; the virtual plane is its ideal pinhole image in px.

    ``board`` is the board on which photographs will be scored. The uncertainty of the other calibration is unknown:
    standard deviations are those of the fit alone. Raises CalibrationError if the lens is one to one hardly anywhere in
    the image.
    """
    lens = _lens(theirs)
    found = _spline(lens)
    details: dict[str, object] = {
        "program": theirs.program,
        "model": theirs.model,
        "board_known": board is not None,
        "fit_rms_px": found.rms_px,
        "fit_largest_px": found.largest_px,
    }
    plane_map = SplineMap(found.surface, found.rms_px / np.sqrt(2.0), found.known)
    calibration = _calibration(theirs, _camera(theirs, plane_map, found.hull, lens.sign), board, square_mm, details)
    covered = found.hull.area / float(np.prod(theirs.image_size))
    return Adopted(calibration, found.rms_px, found.largest_px, covered, found.surface.control.shape[1::-1])


def _calibration(
    theirs: ForeignCamera,
    camera: VirtualCamera,
    board: Board | None,
    square_mm: float | None,
    details: dict[str, object],
) -> Calibration:
    """The calibration that holds ``camera``: without corners, and without standard deviations of K."""
    return Calibration(
        camera,
        CornerSet(board or UNKNOWN_BOARD, theirs.image_size),
        method=IMPORTED,
        kernel="spline",
        trend=theirs.model,
        reference=theirs.source,
        intrinsics_std=np.full(3, np.nan),
        square_mm=square_mm,
        details=details,
    )


def _camera(theirs: ForeignCamera, plane_map: SplineMap, hull: ConvexRegion, sign: float) -> VirtualCamera:
    focal = float(np.sqrt(np.abs(theirs.focal.prod())))
    chart = AngleChart(np.eye(3), Intrinsics(focal, float(theirs.centre[0]), float(theirs.centre[1])))
    return VirtualCamera(plane_map, chart, Domain(hull), theirs.image_size, np.nan, mirrored=sign < 0)


# --- inversion of the lens ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ForeignLens:
    """A projection as a map from azimuthal equidistant angles q (n, 2) to pixels, and its one-to-one part.

    ``angles`` and ``pixels`` (m, 2) sample that part; ``sign`` is the handedness of the image there.
    """

    camera: ForeignCamera
    angles: Floats
    pixels: Floats
    sign: float

    def value(self, q: Floats) -> Floats:
        """Pixels (n, 2) of angles ``q`` (n, 2), nan where there is none."""
        with np.errstate(all="ignore"):
            return self.camera.project(angles_to_directions(q))

    def jacobian(self, q: Floats) -> Floats:
        """∂pixel/∂q (n, 2, 2) by central differences."""
        sides = [(self.value(q + step) - self.value(q - step)) / (2.0 * STEP) for step in STEP * np.eye(2)]
        return np.stack(sides, axis=2)

    def unfolded(self, jacobian: Floats) -> Bools:
        """Where (n,) ∂pixel/∂q (n, 2, 2) keeps the image's handedness, away from a pole."""
        known: Bools = np.asarray(np.isfinite(jacobian).all(axis=(1, 2)))
        good = np.zeros(len(jacobian), dtype=bool)
        largest, smallest = np.linalg.svd(jacobian[known], compute_uv=False).T
        upright = self.sign * np.linalg.det(jacobian[known]) > 0
        good[known] = upright & (largest < MAX_STRETCH_RATIO * smallest)
        return good

    def inverse(self, uv: Floats) -> Floats:
        """Angles q (n, 2) of pixels ``uv`` (n, 2); nan where the one-to-one part has none."""
        start = self.angles[cKDTree(self.pixels).query(uv)[1]]
        q = newton_inverse(self, uv, start, reach=0.05)
        found: Bools = np.asarray(np.isfinite(q).all(axis=1))
        found[found] = self.unfolded(self.jacobian(q[found]))
        return np.where(found[:, None], q, np.nan)


def _lens(theirs: ForeignCamera) -> ForeignLens:
    """``theirs`` with its one-to-one part: along each direction from the axis, up to where it folds."""
    theta = np.geomspace(MIN_ANGLE_RAD, MAX_ANGLE_RAD, ANGLES)
    phi = np.linspace(0.0, 2.0 * np.pi, AZIMUTHS, endpoint=False)
    grid = theta[:, None, None] * np.stack([np.cos(phi), np.sin(phi)], axis=1)
    axis = ForeignLens(theirs, np.zeros((1, 2)), theirs.centre[None], 1.0)
    middle = axis.jacobian(axis.angles)[0]
    if not np.isfinite(middle).all():
        raise _blind(theirs)
    lens = replace(axis, sign=float(np.sign(np.linalg.det(middle))))
    angles = np.concatenate([axis.angles, grid[_followed(lens, grid)]])
    return replace(lens, angles=angles, pixels=lens.value(angles))


def _followed(lens: ForeignLens, grid: Floats) -> Bools:
    """Which points of ``grid`` (angles, azimuths, 2) belong to the one-to-one part: (angles, azimuths).

    Along each direction it ends where the projection folds or has left the image; if the projection returns to the
    image farther out, that is a spurious branch of the formula.
    """
    flat = grid.reshape(-1, 2)
    values = lens.value(flat).reshape(grid.shape)
    good = lens.unfolded(lens.jacobian(flat)).reshape(grid.shape[:2])
    size = np.array(lens.camera.image_size)
    inside: Bools = np.asarray(((values > -0.25 * size) & (values < 1.25 * size)).all(axis=2))
    good[1:] &= inside[1:] | ~np.logical_or.accumulate(inside, axis=0)[:-1]
    return np.logical_and.accumulate(good, axis=0)


def _blind(theirs: ForeignCamera) -> CalibrationError:
    width, height = theirs.image_size
    return CalibrationError(
        f"the {theirs.program} camera covers next to nothing of an image of {width}x{height}: check the image size and "
        "the camera's parameters"
    )


# --- the spline --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class PixelBox:
    """A rectangle of pixels between its outer edges ``low`` and ``high`` (2,) px."""

    low: Floats
    high: Floats

    @property
    def corners(self) -> Floats:
        """Its four corners (4, 2)."""
        return np.array([[u, v] for u in (self.low[0], self.high[0]) for v in (self.low[1], self.high[1])])

    def pixels(self, count: int) -> Floats:
        """A grid of pixels (n, 2) up to its edges, ``count`` along the longer side."""
        sides = map(np.linspace, self.low, self.high, self._counts(count, fewest=3))
        return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)

    def empty(self, cells: int) -> SplineSurface:
        """A zero surface with ``cells`` along the longer side and one control point beyond each edge."""
        counts = self._counts(cells, fewest=1)
        spacing = (self.high - self.low) / counts
        return SplineSurface(self.low - spacing, spacing, np.zeros((counts[1] + 3, counts[0] + 3, 2)))

    def _counts(self, count: int, *, fewest: int) -> list[int]:
        sides = self.high - self.low
        return [max(fewest, round(count * float(side / sides.max()))) for side in sides]


def _frame(image_size: tuple[int, int], margin: float) -> PixelBox:
    """The image, extended on all sides by the fraction ``margin`` of its longer side."""
    size = np.array(image_size, dtype=np.float64)
    beyond = margin * size.max()
    return PixelBox(np.full(2, -0.5 - beyond), size - 0.5 + beyond)


@dataclass(frozen=True, slots=True, eq=False)
class SplineFit:
    """A spline ``surface`` fitted to a lens, valid in the region ``known``; ``hull`` is the part of it in the image.

    ``rms_px`` and ``largest_px`` are the errors over ``known``.
    """

    surface: SplineSurface
    known: ConvexRegion
    hull: ConvexRegion
    rms_px: float
    largest_px: float


def _spline(lens: ForeignLens) -> SplineFit:
    """Fit a spline to ``lens`` over the image, and with a margin around it if the lens is defined everywhere there."""
    image, wider = (_frame(lens.camera.image_size, margin) for margin in (0.0, MARGIN))
    if np.isfinite(lens.inverse(wider.pixels(SAMPLES * CELLS[0] + 1))).all():
        found = _fine_enough(lens, wider)
        if found.known.contains(image.corners).all():
            return replace(found, hull=convex_hull(image.corners))
    return _fine_enough(lens, image)


def _fine_enough(lens: ForeignLens, frame: PixelBox) -> SplineFit:
    """Fit the coarsest spline that reproduces ``lens`` on ``frame``, or else the finest one."""
    for cells in CELLS:
        surface, known = _fit(lens, frame, cells)
        known, rms, largest = _tested(lens, surface, known, frame, cells)
        if largest < TOLERANCE:
            break
    return SplineFit(surface, known, known, rms, largest)


def _fit(lens: ForeignLens, frame: PixelBox, cells: int) -> tuple[SplineSurface, ConvexRegion]:
    """The spline with ``cells`` along the longer side, and the region where the lens is defined."""
    uv = frame.pixels(SAMPLES * cells + 1)
    q = lens.inverse(uv)
    known = np.isfinite(q).all(axis=1)
    region = _region(lens, uv[known], uv[~known])
    return fitted(frame.empty(cells), uv[known], q[known]), region


def _tested(
    lens: ForeignLens, surface: SplineSurface, known: ConvexRegion, frame: PixelBox, cells: int
) -> tuple[ConvexRegion, float, float]:
    """The part of ``known`` where the spline reproduces the lens, with the RMS and the largest error there in px.

    An error is the distance between a pixel and the lens's projection of the spline's ray for it.
    """

    def errors_at(uv: Floats) -> Floats:
        errors = np.linalg.norm(lens.value(surface.value(uv)) - uv, axis=1)
        return np.where(known.contains(uv), errors, np.nan)

    grid = frame.pixels(3 * cells)  # between the pixels of the fit, and on the border
    spacing = float((frame.high - frame.low).max()) / (3 * cells - 1)
    while True:
        uv = np.concatenate([grid, worst_places(errors_at, grid, spacing)])
        errors = errors_at(uv)
        if not (errors >= WORST).any():
            return known, float(np.sqrt(np.nanmean(errors[: len(grid)] ** 2))), float(np.nanmax(errors))
        known = _region(lens, uv[errors < WORST], uv[errors >= WORST])


def _region(lens: ForeignLens, known: Floats, unknown: Floats) -> ConvexRegion:
    """A convex region of ``known`` pixels (n, 2) without ``unknown`` (m, 2); raises CalibrationError if it is tiny."""
    width, height = lens.camera.image_size
    if len(known) < 3 or (hull := _inscribed(known, unknown)).area < MIN_COVERED_SHARE * width * height:
        raise _blind(lens.camera)
    return hull


def _inscribed(known: Floats, unknown: Floats) -> ConvexRegion:
    """A large convex region of ``known`` pixels (n, 2) without any ``unknown`` (m, 2) inside."""
    hull = convex_hull(known)
    while len(intruders := unknown[hull.contains(unknown)]):
        middle = known.mean(axis=0)
        towards = intruders[np.linalg.norm(intruders - middle, axis=1).argmin()] - middle
        known = known[(known - middle) @ towards < 0.999 * (towards @ towards)]
        hull = convex_hull(known)
    return hull
