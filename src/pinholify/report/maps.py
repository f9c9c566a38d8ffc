"""Maps over the image: where boards were seen, how well the map is known, and the residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.result import Calibration
from pinholify.camera import VirtualCamera
from pinholify.evaluation.measures import rms
from pinholify.evaluation.verdict import CornerResiduals, Verdict
from pinholify.geometry import convex_hull
from pinholify.rectification.valid_region import valid_share
from pinholify.report.contours import Polygons, grid_pixels, region_inside, regions_above
from pinholify.report.numerals import round_down

LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # px
UNKNOWN = 1e9  # px: stands for a standard deviation that does not exist
CELLS = 16  # along the image's longer side
MIN_CORNERS_IN_CELL = 3
SHOWN_ARROW = 0.8  # length of the longest arrow of the residual field as drawn, as a fraction of a cell


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Outlines (n, 2) px of the camera's domain (``believed``), each counted board's corners and the best next board.

    ``share`` is the fraction of the image in the domain, ``shown`` the fraction that straightened pictures show: where
    the map is known to ``limit_px``, or the domain if that is infinite.
    """

    share: float
    believed: Polygons
    boards: Polygons
    next_board: Floats | None
    shown: float
    limit_px: float


def coverage_of(calibration: Calibration, verdict: Verdict, seen: CornerResiduals, std: Floats) -> Coverage:
    """Where boards were seen; ``std`` is :func:`std_over_image` of the camera."""
    camera = calibration.camera
    log_std, limit = np.log(std), np.log(camera.domain.max_std)
    views = [view for view in calibration.corner_set.found if view.name in seen.inliers]
    return Coverage(
        verdict.coverage,
        region_inside(camera.domain.hull, log_std, limit, camera.image_size),
        tuple(convex_hull(view.uv[seen.inliers[view.name]]).vertices for view in views),
        None if verdict.next_board is None else verdict.next_board.outline,
        valid_share(camera),
        camera.domain.max_std,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Certainty:
    """The standard deviation of the map's shape over the image, in px.

    ``regions`` outline where it is at least each of ``levels``; ``inside_px`` and ``image_px`` are its medians in the
    camera's domain and over the whole image.
    """

    levels: tuple[float, ...]
    regions: tuple[Polygons, ...]
    inside_px: float
    image_px: float


def certainty_of(camera: VirtualCamera, std: Floats) -> Certainty:
    """How well the map of ``camera`` is known: contours of ``std``, its :func:`std_over_image`."""
    lowest = max((level for level in LEVELS if level <= std.min()), default=LEVELS[0])
    levels = tuple(level for level in LEVELS if lowest <= level <= std.max())
    regions = regions_above(np.log(std), tuple(np.log(levels)), camera.image_size)
    inside = camera.inside(grid_pixels(camera.image_size))
    within = float(np.median(std[inside])) if inside.any() else float("nan")
    return Certainty(levels, regions, within, float(np.median(std)))


def std_over_image(camera: VirtualCamera) -> Floats:
    """Standard deviation (n,) of the map's shape at the grid's nodes in px, positive and finite."""
    with np.errstate(all="ignore"):
        std = camera.shape_std(grid_pixels(camera.image_size))
    return np.clip(np.nan_to_num(std, nan=UNKNOWN), 1.0 / UNKNOWN, UNKNOWN)


@dataclass(frozen=True, slots=True, eq=False)
class ResidualField:
    """Residuals averaged over cells of the image, in px, and tests for structure in them.

    ``centres`` (n, 2) of the cells with their ``means`` (n, 2), drawn ``magnification`` times as long. ``all`` (m, 2)
    are the residuals themselves, ``rms_px`` their RMS per point, ``noise_px`` the corner noise per axis.
    ``correlation`` is that of neighbours on different boards, with ``p_value`` if there is none. ``board_error_px`` per
    point is the error that each corner of the board has on all photographs, with ``board_error_p_value`` if there is
    none.
    """

    centres: Floats
    means: Floats
    magnification: float
    all: Floats
    rms_px: float
    noise_px: float
    correlation: float
    p_value: float
    board_error_px: float
    board_error_p_value: float


def residual_field(calibration: Calibration, verdict: Verdict, seen: CornerResiduals) -> ResidualField:
    """The residuals that the camera leaves, over the image."""
    views = [view for view in calibration.corner_set.found if view.name in seen.residuals]
    uv = np.concatenate([view.uv[seen.inliers[view.name]] for view in views])
    residuals = np.concatenate([seen.residuals[view.name][seen.inliers[view.name]] for view in views])
    width, height = calibration.camera.image_size
    cell = max(width, height) / CELLS
    centres, means = _cell_means(uv, residuals, cell)
    longest = float(np.linalg.norm(means, axis=1).max(initial=0.0))
    return ResidualField(
        centres,
        means,
        round_down(SHOWN_ARROW * cell / longest) if longest > 0 else 1.0,
        residuals,
        rms(residuals),
        calibration.camera.noise_px,
        verdict.structure.correlation,
        verdict.structure.p_value,
        verdict.shared.rms,
        verdict.shared.p_value,
    )


def _cell_means(uv: Floats, residuals: Floats, cell: float) -> tuple[Floats, Floats]:
    """Centres and mean residuals, (n, 2) each, of the square cells that hold enough corners."""
    places, index, counts = np.unique(np.floor(uv / cell), axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(places), 2))
    np.add.at(sums, index.reshape(-1), residuals)
    enough = counts >= MIN_CORNERS_IN_CELL
    return (places[enough] + 0.5) * cell, sums[enough] / counts[enough, None]
