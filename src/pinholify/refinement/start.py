"""The start of the joint solve: a scan over simple lenses, with the poses of all boards in closed form.

A simple lens has two parameters: the angle at the image's corners, and the law by which the radius grows with the
angle, r ∝ tan(aθ)/a (pinhole a = 1, stereographic ½, equidistant 0, more compressed for a² < 0). For each lens, the
boards' poses follow from the directions of their corners by a direct linear transform, which works beyond 90° too. The
lens with the smallest median misfit of boards starts the solve.

A camera that is given, an earlier one or another program's, is one more lens: it may have what no scan covers, such as
an axis outside the image. It starts the solve where it explains the corners clearly better than the scan's lens.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.calibration.numbering import FEWEST_CORNERS
from pinholify.calibration.poses import poses_of_directions
from pinholify.camera import VirtualCamera
from pinholify.charts import AngleChart, angles_to_directions, directions_to_angles
from pinholify.errors import CalibrationError, InputError
from pinholify.geometry import rotation_about_z
from pinholify.refinement.candidates import Setting
from pinholify.refinement.model import Model, State
from pinholify.refinement.observations import ImageFrame, Observations
from pinholify.refinement.outliers import with_enough
from pinholify.refinement.posing import reposed, righted
from pinholify.refinement.solver import Loss, Solution, minimise
from pinholify.refinement.trends import Angles, LensTrend
from pinholify.refinement.trends.fitting import fit_trend, levelling_rotation

CORNER_ANGLES_RAD = np.deg2rad([6, 10, 15, 20, 26, 32, 38, 45, 52, 60, 70, 80, 90, 100, 115])
LENS_SHAPES = (1.0, 0.5, 0.0, -0.7)  # of the scan: |a|, with the sign of a²
SCAN_BOARDS = 16  # the largest ones
START_STEPS = 10  # a solve that has not converged by then has the wrong lens
MISFIT_RATIO = 5.0  # boards that fit this much worse than the median one wait until the camera is known
LENSES_KEPT = 2  # of the scan, each of which is solved
ROBUST_LOSS = Loss(None, 3.0)
CLEAR_NOISE_RATIO = 1.2  # of two starts' noise: beyond it one is clearly better
LEVELLING_GRID = 12  # pixels along each side of the image, whose rays level a given camera


class Lens(Protocol):
    """A lens for which poses can be found."""

    def directions(self, x: Floats) -> Floats:
        """Unit directions (n, 3) of normalised image points ``x`` (n, 2); nan where the lens has no ray."""
        ...

    def radian(self, x: Floats) -> Floats:
        """The length (n,) of a radian in the image at ``x`` (n, 2), in normalised units."""
        ...


@dataclass(frozen=True, slots=True)
class SimpleLens:
    """A radial lens about the image's middle: ``corner_angle`` (radians) at radius 1, ``shape`` |a| signed as a²."""

    corner_angle: float
    shape: float

    def angle(self, radius: Floats) -> Floats:
        """Angles θ (n,) in radians at normalised ``radius`` (n,); nan where the lens has no ray."""
        a, end = abs(self.shape), self.corner_angle
        with np.errstate(invalid="ignore", divide="ignore"):
            if self.shape > 0:
                return np.asarray(np.arctan(radius * np.tan(a * end)) / a)
            if self.shape < 0:
                return np.asarray(np.arctanh(radius * np.tanh(a * end)) / a)
            return radius * end

    def slope(self, radius: Floats) -> Floats:
        """The derivative dr/dθ (n,) at normalised ``radius`` (n,)."""
        a, end = abs(self.shape), self.corner_angle
        if self.shape > 0:
            scale = np.tan(a * end)
            return np.asarray(a * (1.0 + (radius * scale) ** 2) / scale)
        if self.shape < 0:
            scale = np.tanh(a * end)
            return np.asarray(a * (1.0 - (radius * scale) ** 2) / scale)
        return np.full(len(radius), 1.0 / end)

    def directions(self, x: Floats) -> Floats:
        """Unit directions (n, 3) of normalised image points ``x`` (n, 2); nan where the lens has no ray."""
        radius = np.linalg.norm(x, axis=1)
        return angles_to_directions(x * (self.angle(radius) / np.maximum(radius, 1e-12))[:, None])

    def radian(self, x: Floats) -> Floats:
        """The length (n,) in the image of a radian along the radius at ``x`` (n, 2), in normalised units."""
        return self.slope(np.linalg.norm(x, axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class GivenLens:
    """A ``camera`` as a lens in the normalised coordinates of ``frame``, turned by ``turn`` (3, 3) to the trends' axis.

    That axis is the camera's own, or the ray of the image's middle where it has none, with the image upright.
    """

    camera: VirtualCamera
    frame: ImageFrame
    turn: Floats

    def directions(self, x: Floats) -> Floats:
        """Unit directions (n, 3) of normalised image points ``x`` (n, 2), also outside the camera's domain."""
        camera, uv = self.camera, self.frame.restore(x)
        return np.asarray(camera.chart.directions(camera.plane_map.value(uv)) @ self.turn.T)

    def radian(self, x: Floats) -> Floats:
        """The length (n,) of a radian in the image at ``x`` (n, 2), its geometric mean over directions."""
        camera, uv = self.camera, self.frame.restore(x)
        by_chart = camera.chart.direction_jacobian(camera.plane_map.value(uv))
        by_u, by_v = np.moveaxis(by_chart @ camera.plane_map.jacobian(uv), 2, 0)
        return np.asarray(np.linalg.norm(np.cross(by_u, by_v), axis=1) ** -0.5 / self.frame.scale)

    def inside(self, x: Floats) -> Bools:
        """Whether (n,) normalised image points ``x`` (n, 2) are in the camera's domain."""
        return self.camera.inside(self.frame.restore(x))


def given_lens(camera: VirtualCamera, frame: ImageFrame, image_size: tuple[int, int]) -> GivenLens:
    """``camera`` as a start for images of ``image_size`` (width, height) px; raises InputError if its size differs."""
    if camera.image_size != image_size:
        (width, height), (given_width, given_height) = image_size, camera.image_size
        raise InputError(
            f"the start is a camera for images of {given_width}x{given_height}, but these images are {width}x{height}: "
            "make the camera of this mode with 'pinholify mode', or calibrate without a start"
        )
    sides = [np.linspace(0.0, n - 1.0, LEVELLING_GRID) for n in image_size]
    uv = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    uv = np.concatenate([uv[camera.inside(uv)], camera.domain.hull.vertices])
    x, directions = frame.normalise(uv), camera.chart.directions(camera.plane_map.value(uv))
    if not isinstance(camera.chart, AngleChart):
        return GivenLens(camera, frame, levelling_rotation(x, directions))
    turn = camera.chart.rotation.T
    return GivenLens(camera, frame, _upright(x, directions @ turn.T) @ turn)


def _upright(x: Floats, directions: Floats) -> Floats:
    """The rotation (3, 3) about z after which ``directions`` (n, 3) have the azimuths of their image points ``x``."""
    (a, b), (c, d) = (x - x.mean(axis=0)).T @ directions_to_angles(directions)
    return rotation_about_z(float(np.arctan2(b - c, a + d)))


def simple_lenses() -> list[SimpleLens]:
    """All lenses of the scan, without those whose corners would be near or beyond the end of the law."""
    return [
        SimpleLens(float(angle), shape)
        for angle in CORNER_ANGLES_RAD
        for shape in LENS_SHAPES
        if shape <= 0 or shape * angle < 0.9 * np.pi / 2
    ]


def board_misfit(lens: Lens, seen: Observations) -> tuple[Floats, Floats, Floats]:
    """RMS misfit (K,) of each board under ``lens``, in normalised image units, and the poses as in closed form.

    The misfit of a board is inf where the lens has no ray at one of its corners.
    """
    directions = lens.directions(seen.image)
    blind = ~np.isfinite(directions).all(axis=1)
    directions[blind] = [0.0, 0.0, 1.0]
    rotations, translations = poses_of_directions(directions, seen.lattice, seen.starts)
    camera = np.einsum("nij,nj->ni", rotations[seen.view][:, :, :2], seen.lattice) + translations[seen.view]
    unit = camera / np.linalg.norm(camera, axis=1, keepdims=True)
    squares = ((unit - directions) ** 2).sum(axis=1) * lens.radian(seen.image) ** 2
    misfit = np.sqrt(seen.sums(np.where(blind, np.inf, squares)) / seen.sums(np.ones(len(squares))))
    return misfit, rotations, translations


def largest_boards(seen: Observations, most: int) -> Bools:
    """Mask (N,) of the corners of the ``most`` boards that spread widest in the image."""
    counts = seen.sums(np.ones(len(seen.view)))
    mean = seen.sums(seen.image) / counts[:, None]
    spread = seen.sums(((seen.image - mean[seen.view]) ** 2).sum(axis=1)) / counts
    chosen = np.argsort(-np.where(counts >= FEWEST_CORNERS, spread, -1.0))[:most]
    return np.isin(seen.view, chosen)


def scan(seen: Observations, count: int) -> list[SimpleLens]:
    """The ``count`` simple lenses with the smallest median misfit of the largest boards, best first.

    Raises CalibrationError where no lens has a finite one.
    """
    some = seen.select(largest_boards(seen, SCAN_BOARDS))
    scores = [(float(np.median(board_misfit(lens, some)[0])), lens) for lens in simple_lenses()]
    finite = sorted((score for score in scores if np.isfinite(score[0])), key=lambda score: score[0])
    if not finite:
        raise CalibrationError(
            "no lens between telephoto and fisheye explains the corners: check the board's size"
        )
    return [lens for _, lens in finite[:count]]


def first_solution(setting: Setting, seen: Observations, given: GivenLens | None) -> tuple[Solution, bool | None]:
    """The robust solve of all boards with two radial coefficients from the best lens, and whether ``given`` fits.

    The lens of the scan is taken unless the ``given`` one is clearly better, so that a start changes nothing where none
    is needed. The given one fits unless it is clearly worse; whether it does is None where none is given. The trend is
    a distorting one, which sees every ray whatever its parameters. Raises CalibrationError where nothing fits.
    """
    model = setting.model(LensTrend(Angles(), True, 2, tangent=False))
    from_given = None if given is None else _from_given(model, given, seen)
    try:
        scanned = _from_lenses(model, scan(seen, LENSES_KEPT), seen)
    except CalibrationError:
        if from_given is None:
            raise
        return from_given, True
    if from_given is None:
        return scanned, None if given is None else False
    better = CLEAR_NOISE_RATIO * from_given.noise < scanned.noise
    return from_given if better else scanned, from_given.noise <= CLEAR_NOISE_RATIO * scanned.noise


def _from_given(model: Model, given: GivenLens, seen: Observations) -> Solution | None:
    """The solve from ``given`` by all corners, or by those in its domain alone, whichever leaves less noise.

    None where neither can be solved.
    """
    inside = with_enough(seen, given.inside(seen.image))
    parts = [seen] if inside.all() or not inside.any() else [seen, seen.select(inside)]
    found = [_of_all_boards(s, seen) for part in parts if (s := _solve_from(model, given, part)) is not None]
    return min(found, key=lambda solution: solution.noise, default=None)


def _from_lenses(model: Model, lenses: Iterable[Lens], seen: Observations) -> Solution:
    """The solve from the one of ``lenses`` that leaves the least noise."""
    found = [s for lens in lenses if (s := _solve_from(model, lens, seen)) is not None]
    if not found:
        raise CalibrationError("no camera explains the corners of most boards: check the board's size")
    return with_poses_righted(_of_all_boards(min(found, key=lambda solution: solution.noise), seen), seen)


def _of_all_boards(found: Solution, seen: Observations) -> Solution:
    """``found``, a solution of some boards, solved again for all of them."""
    model = found.model
    state = reposed(model, found.state, seen)
    return minimise(model, state, seen, model.trend_precision(), ROBUST_LOSS, most_steps=START_STEPS) or found


def with_poses_righted(known: Solution, seen: Observations) -> Solution:
    """``known``, solved again where a board of ``seen`` had been caught in a wrong pose."""
    precision = known.model.trend_precision()
    state = righted(known.model, known.state, seen, precision)
    if state is known.state:
        return known
    return minimise(known.model, state, seen, precision, ROBUST_LOSS, most_steps=START_STEPS) or known


def _solve_from(model: Model, lens: Lens, seen: Observations) -> Solution | None:
    """The solve from ``lens`` by the boards that fit it; None where the trend cannot be fitted to it."""
    misfit, rotations, translations = board_misfit(lens, seen)
    sees = np.isfinite(misfit)
    if not sees.any():
        return None
    good = sees & (misfit <= MISFIT_RATIO * np.median(misfit[sees]))
    some = seen.select(good[seen.view])
    beta = fit_trend(model.trend, some.image, lens.directions(some.image))
    if beta is None:
        return None
    eta = np.zeros(len(model.shape.prior_std))
    state = State.still(beta, eta, rotations[good], translations[good])
    return minimise(model, state, some, model.trend_precision(), ROBUST_LOSS, most_steps=START_STEPS)
