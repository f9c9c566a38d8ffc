"""mrcal's .cameramodel with LENSMODEL_SPLINED_STEREOGRAPHIC: the camera itself instead of a view.

mrcal's spline displaces the stereographic point u of a ray. With fx, fy, cx, cy from a straight-line fit, its control
points follow from rays and their pixels by one linear solve (https://mrcal.secretsauce.net/lensmodels.html). The
spline is refined until it reproduces the camera. Its frame is that of the view, as in the pinhole models of the
``mrcal`` format, so both have the correct relative orientation.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.arrays import Bools, Floats
from pinholify.errors import CalibrationError
from pinholify.geometry import convex_hull, homogeneous
from pinholify.io.export.base import Format, PinholeExport, commented, numbers
from pinholify.io.files import writing_text
from pinholify.io.importing.base import Projection
from pinholify.io.importing.mrcal import knots
from pinholify.io.importing.projections import splined_stereographic, stereographic_plane
from pinholify.rectification.valid_region import valid_pixels
from pinholify.splines import SplineSurface, fitted, rounded_up, worst_places

ORDER = 3
COLUMNS = (16, 24, 36, 54, 80)
"""Numbers of control points across, tried in this order."""

TOLERANCE = 0.01  # px; largest error of the spline below which no finer one is tried
SAMPLES = 3  # pixels per control point and axis
BORDER = 500  # pixels along the border
MIN_COSINE = np.cos(np.deg2rad(172.0))  # the stereographic plane ends straight behind


@dataclass(frozen=True, slots=True, eq=False)
class SplinedModel:
    """LENSMODEL_SPLINED_STEREOGRAPHIC: ``core`` (4,) fx, fy, cx, cy px, ``surface`` over u, ``fov_x`` whole degrees.

    ``rms_px`` and ``largest_px`` are its errors where the camera can be trusted, ``region`` (n, 2) px is the hull of
    that part of the image, and ``left_out`` is the share of the image outside it.
    """

    core: Floats
    surface: SplineSurface
    fov_x: int
    rms_px: float
    largest_px: float
    region: Floats
    left_out: float

    @property
    def name(self) -> str:
        """mrcal's name of the lens model."""
        rows, columns, _ = self.surface.control.shape
        return f"LENSMODEL_SPLINED_STEREOGRAPHIC_order={ORDER}_Nx={columns}_Ny={rows}_fov_x_deg={self.fov_x}"

    @property
    def sentences(self) -> list[str]:
        """Sentences on the fit error, and on what the model leaves out."""
        rows, columns, _ = self.surface.control.shape
        fit = f"{columns}x{rows} control points reproduce the camera to {self.rms_px:.2g} px RMS"
        sentences = [f"{fit}, {rounded_up(self.largest_px)} px at most, where it can be trusted"]
        if self.left_out >= 0.0005:
            sentences.append(
                f"{100 * self.left_out:.1f} % of the image cannot be trusted: there, outside its "
                "valid_intrinsics_region, the model extrapolates smoothly"
            )
        return [*sentences, "the format cannot hold standard deviations without mrcal's own optimization inputs"]


def splined_model(export: PinholeExport) -> SplinedModel:
    """Fit the spline to the camera of ``export``; raises CalibrationError if too little of the image can be trusted."""
    for columns in COLUMNS:
        model = _fit(export, columns)
        if model.largest_px < TOLERANCE:
            break
    return model


def _fit(export: PinholeExport, columns: int) -> SplinedModel:
    grid = _grid(export, SAMPLES * columns)
    places = np.concatenate([grid, _border(export)])
    directions = _directions(export, places)
    seen: Bools = np.asarray(np.isfinite(directions).all(axis=1))
    share = float(seen[: len(grid)].mean())
    if share * len(grid) < ORDER**2:
        raise CalibrationError("too little of the image can be trusted to fit a spline; allow a larger max_std")
    uv, u = places[seen], stereographic_plane(directions[seen])
    core = _core(u, uv)
    empty, fov_x = _empty(np.abs(u).max(axis=0), columns)
    surface = fitted(empty, u, (uv - core[2:]) / core[:2] - u)
    rms, largest = _errors(export, splined_stereographic(core, surface), columns)
    return SplinedModel(core, surface, fov_x, rms, largest, convex_hull(uv).vertices, 1.0 - share)


def _errors(export: PinholeExport, project: Projection, columns: int) -> tuple[float, float]:
    """RMS and largest error of ``project``, in px, where the camera can be trusted."""

    def errors_at(uv: Floats) -> Floats:
        return np.asarray(np.linalg.norm(project(_directions(export, uv)) - uv, axis=1))

    count = SAMPLES * columns + 1  # between the samples of the fit
    grid = _grid(export, count)
    errors = errors_at(grid)
    worst = errors_at(worst_places(errors_at, grid, max(export.camera.image_size) / count))
    return float(np.sqrt(np.nanmean(errors**2))), float(max(np.nanmax(errors), np.nanmax(worst)))


def _grid(export: PinholeExport, count: int) -> Floats:
    """A grid of pixels (n, 2) over the image, ``count`` along the longer side."""
    size = export.camera.image_size
    sides = [np.linspace(0.0, n - 1.0, max(8, round(count * n / max(size)))) for n in size]
    return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)


def _border(export: PinholeExport) -> Floats:
    """Pixels (n, 2) along the border of the domain's hull, beyond the grid, where a spline without data diverges."""
    hull = export.camera.domain.hull.vertices
    along = np.linspace(0.0, 1.0, 1 + BORDER // len(hull), endpoint=False)[:, None, None]
    return np.asarray((hull + along * (np.roll(hull, -1, axis=0) - hull)).reshape(-1, 2))


def _directions(export: PinholeExport, uv: Floats) -> Floats:
    """Directions (n, 3), in the view's frame, of pixels; nan where they cannot be trusted, and straight behind."""
    camera, directions = export.camera, np.full((len(uv), 3), np.nan)
    known = valid_pixels(camera, uv, export.options.max_std)
    directions[known] = camera.chart.directions(camera.plane_map.value(uv[known])) @ export.view.rotation.T
    directions[~(directions[:, 2] > MIN_COSINE)] = np.nan
    return directions


def _core(u: Floats, uv: Floats) -> Floats:
    """fx, fy, cx, cy (4,) of straight lines fitted to u and pixels; the residual is left to the spline."""
    lines = [np.linalg.lstsq(homogeneous(u[:, axis, None]), uv[:, axis], rcond=None)[0] for axis in (0, 1)]
    return np.array(lines).T.ravel()


def _empty(widest: Floats, columns: int) -> tuple[SplineSurface, int]:
    """A zero surface whose patches reach ``widest`` (2,) from the axis, and its field of view in whole degrees."""
    fov_x = int(np.ceil(np.rad2deg(4.0 * np.arctan(widest[0] / 2.0))))
    spacing, _ = knots(ORDER, columns, columns, fov_x)
    rows = max(ORDER + 1, int(np.ceil(2.0 * widest[1] / spacing)) + ORDER)
    spacing, origin = knots(ORDER, columns, rows, fov_x)
    return SplineSurface(origin, np.full(2, spacing), np.zeros((rows, columns, 2)), ORDER), fov_x


def write(export: PinholeExport, path: Path) -> list[str]:
    """Write fx, fy, cx, cy and the control points, row by row, x and y of each; returns sentences on the fit."""
    model = splined_model(export)
    width, height = export.camera.image_size
    turn = Rotation.from_matrix(export.view.rotation).as_rotvec()
    contour = ", ".join(f"[{numbers(corner)}]" for corner in [*model.region, model.region[0]])
    lines = (
        "{",
        f"    'lensmodel': '{model.name}',",
        f"    'intrinsics': [ {numbers(model.core)}, {numbers(model.surface.control)},],",
        f"    'valid_intrinsics_region': [ {contour} ],",
        f"    'extrinsics': [ {numbers(turn)}, 0.0, 0.0, 0.0,],",
        f"    'imagersize': [ {width}, {height},]",
        "}",
    )
    with writing_text(path) as stream:
        stream.write(commented((STATEMENT, *model.sentences)) + "\n".join(lines) + "\n")
    return model.sentences


STATEMENT = "A camera calibrated by pinholify; it describes the original images: do not straighten them first."

FORMAT = Format((".cameramodel",), write, of_view=False)
