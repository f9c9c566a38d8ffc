"""Another program's camera made ours: its map of the image, pixel by pixel, carried by a spline.

Any lens that can be projected is taken in alike: its projection is inverted numerically where it is one to one, from
the axis outwards, and the spline is made finer until it repeats the lens.
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

TOLERANCE = 1e-3  # px between their camera and ours at which a finer spline is not tried
WORST = 0.05
"""px of error beyond which a spline does not repeat their camera: where it folds or ends soon."""

CELLS = (16, 32, 64, 128)
"""Cells of the spline along the longer side of the image, as many as are needed."""

SAMPLES = 2  # a cell and axis, to fit and to test
MARGIN = 0.06
"""Of the image's longer side: how far beyond the image a lens is repeated that goes on there. What is made of a map in
large smooth pieces needs some of it on the border's far side."""

WIDEST = np.deg2rad(172.0)  # from the axis; straight behind, the direction away from the axis has no meaning
NARROWEST = 1e-4  # radians
AZIMUTHS, ANGLES = 120, 250
MOST_STRETCHED = 12.0  # times longer along one axis than along the other: a pole of the projection is near
STEP = 1e-6  # radians, to differentiate a projection
LEAST_COVERED = 0.01  # of the image, or the numbers are hardly those of a lens

UNKNOWN_BOARD = Checkerboard(3, 3)
"""Stands in a camera file for the board of a camera that came without one."""


@dataclass(frozen=True, slots=True, eq=False)
class Adopted:
    """Their camera as ours and how well it is repeated inside the domain: ``rms_px``, ``largest_px`` per point.

    ``covered`` is the share of the image that their camera says something of, ``knots`` the spline's control points.
    """

    calibration: Calibration
    rms_px: float
    largest_px: float
    covered: float
    knots: tuple[int, int]


def adopt(theirs: ForeignCamera, *, board: Board | None = None, square_mm: float | None = None) -> Adopted:
    """``theirs`` as a camera of ours, in its own frame, the virtual plane that of its ideal pinhole image in px.

    ``board`` is the one that photographs would be scored on. How well theirs was calibrated is not told: standard
    deviations are those of the fit alone. Raises CalibrationError where their camera is one to one hardly anywhere in
    the image.
    """
    lens = _lens(theirs)
    found = _repetition(lens)
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
    """What is known of how ``camera`` came about: no corners, and no error bars of K."""
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
    intrinsics = Intrinsics(focal, float(theirs.centre[0]), float(theirs.centre[1]))
    return VirtualCamera(
        plane_map, AngleChart(np.eye(3)), intrinsics, Domain(hull), theirs.image_size, np.nan, mirrored=sign < 0
    )


# --- their lens, inverted ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """A projection as a map from angles q (n, 2), azimuthal equidistant, to pixels, and its one-to-one part.

    ``angles`` and ``pixels`` (m, 2) sample that part; ``sign`` is the handedness of the image there.
    """

    camera: ForeignCamera
    angles: Floats
    pixels: Floats
    sign: float

    def value(self, q: Floats) -> Floats:
        """Pixels (n, 2)."""
        with np.errstate(all="ignore"):
            return self.camera.project(angles_to_directions(q))

    def jacobian(self, q: Floats) -> Floats:
        """∂pixel/∂q (n, 2, 2), by differences."""
        sides = [(self.value(q + step) - self.value(q - step)) / (2.0 * STEP) for step in STEP * np.eye(2)]
        return np.stack(sides, axis=2)

    def unfolded(self, jacobian: Floats) -> Bools:
        """Where ∂pixel/∂q (n, 2, 2) keeps the image's handedness, far from a pole."""
        known: Bools = np.asarray(np.isfinite(jacobian).all(axis=(1, 2)))
        good = np.zeros(len(jacobian), dtype=bool)
        largest, smallest = np.linalg.svd(jacobian[known], compute_uv=False).T
        upright = self.sign * np.linalg.det(jacobian[known]) > 0
        good[known] = upright & (largest < MOST_STRETCHED * smallest)
        return good

    def inverse(self, uv: Floats) -> Floats:
        """q (n, 2) of pixels ``uv`` (n, 2); nan where there is none on the one-to-one part."""
        start = self.angles[cKDTree(self.pixels).query(uv)[1]]
        q = newton_inverse(self, uv, start, reach=0.05)
        found: Bools = np.asarray(np.isfinite(q).all(axis=1))
        found[found] = self.unfolded(self.jacobian(q[found]))
        return np.where(found[:, None], q, np.nan)


def _lens(theirs: ForeignCamera) -> Lens:
    """``theirs`` with its one-to-one part: along each direction from the axis, as far as it does not fold."""
    theta = np.geomspace(NARROWEST, WIDEST, ANGLES)
    phi = np.linspace(0.0, 2.0 * np.pi, AZIMUTHS, endpoint=False)
    grid = theta[:, None, None] * np.stack([np.cos(phi), np.sin(phi)], axis=1)
    axis = Lens(theirs, np.zeros((1, 2)), theirs.centre[None], 1.0)
    middle = axis.jacobian(axis.angles)[0]
    if not np.isfinite(middle).all():
        raise _blind(theirs)
    lens = replace(axis, sign=float(np.sign(np.linalg.det(middle))))
    angles = np.concatenate([axis.angles, grid[_followed(lens, grid)]])
    return replace(lens, angles=angles, pixels=lens.value(angles))


def _followed(lens: Lens, grid: Floats) -> Bools:
    """How far along each direction of ``grid`` (angles, azimuths, 2) the image goes on: (angles, azimuths).

    It ends where it folds and where it has left the image: what comes back beyond is another part of the formula.
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
        f"the {theirs.program} camera sees next to nothing in an image of {width}x{height}: check the size of the "
        "images and the camera's numbers"
    )


# --- the spline --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A rectangle of pixels between its outer edges ``low`` and ``high`` (2,) px."""

    low: Floats
    high: Floats

    @property
    def corners(self) -> Floats:
        """Its four corners (4, 2)."""
        return np.array([[u, v] for u in (self.low[0], self.high[0]) for v in (self.low[1], self.high[1])])

    def pixels(self, count: int) -> Floats:
        """A grid (n, 2) out to its edges, ``count`` pixels along the longer side."""
        sides = map(np.linspace, self.low, self.high, self._counts(count, fewest=3))
        return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)

    def empty(self, cells: int) -> SplineSurface:
        """A surface without content, ``cells`` along the longer side: a control point beyond each edge."""
        counts = self._counts(cells, fewest=1)
        spacing = (self.high - self.low) / counts
        return SplineSurface(self.low - spacing, spacing, np.zeros((counts[1] + 3, counts[0] + 3, 2)))

    def _counts(self, count: int, *, fewest: int) -> list[int]:
        sides = self.high - self.low
        return [max(fewest, round(count * float(side / sides.max()))) for side in sides]


def _frame(image_size: tuple[int, int], margin: float) -> Frame:
    """The image, wider by ``margin`` of its longer side all around."""
    size = np.array(image_size, dtype=np.float64)
    beyond = margin * size.max()
    return Frame(np.full(2, -0.5 - beyond), size - 0.5 + beyond)


@dataclass(frozen=True, slots=True, eq=False)
class Repetition:
    """A lens repeated by a ``surface``: ``known`` is where, ``hull`` its part of the image.

    ``rms_px`` and ``largest_px`` are of the errors all over ``known``.
    """

    surface: SplineSurface
    known: ConvexRegion
    hull: ConvexRegion
    rms_px: float
    largest_px: float


def _repetition(lens: Lens) -> Repetition:
    """The spline of ``lens``: of the image, and beyond it where the lens goes on all around."""
    image, wider = (_frame(lens.camera.image_size, margin) for margin in (0.0, MARGIN))
    if np.isfinite(lens.inverse(wider.pixels(SAMPLES * CELLS[0] + 1))).all():
        found = _fine_enough(lens, wider)
        if found.known.contains(image.corners).all():
            return replace(found, hull=convex_hull(image.corners))
    return _fine_enough(lens, image)


def _fine_enough(lens: Lens, frame: Frame) -> Repetition:
    """The spline of few cells that repeats ``lens`` on ``frame``, or of as many as there may be."""
    for cells in CELLS:
        surface, known = _fit(lens, frame, cells)
        known, rms, largest = _repeated(lens, surface, known, frame, cells)
        if largest < TOLERANCE:
            break
    return Repetition(surface, known, known, rms, largest)


def _fit(lens: Lens, frame: Frame, cells: int) -> tuple[SplineSurface, ConvexRegion]:
    """The spline of ``cells`` along the longer side, and where their lens says something."""
    uv = frame.pixels(SAMPLES * cells + 1)
    q = lens.inverse(uv)
    known = np.isfinite(q).all(axis=1)
    region = _believed(lens, uv[known], uv[~known])
    return fitted(frame.empty(cells), uv[known], q[known]), region


def _repeated(
    lens: Lens, surface: SplineSurface, known: ConvexRegion, frame: Frame, cells: int
) -> tuple[ConvexRegion, float, float]:
    """The part of ``known`` where the spline repeats their lens, and of the errors there the rms and the largest, px.

    They are the distances between pixels and where their lens puts the spline's rays.
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
        known = _believed(lens, uv[errors < WORST], uv[errors >= WORST])


def _believed(lens: Lens, known: Floats, unknown: Floats) -> ConvexRegion:
    """A convex region of ``known`` pixels (n, 2) without ``unknown`` (m, 2), if it is more than next to nothing."""
    width, height = lens.camera.image_size
    if len(known) < 3 or (hull := _inscribed(known, unknown)).area < LEAST_COVERED * width * height:
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
