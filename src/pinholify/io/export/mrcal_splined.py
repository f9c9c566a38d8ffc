"""mrcal's .cameramodel with LENSMODEL_SPLINED_STEREOGRAPHIC: the camera itself, no view of it.

mrcal's spline moves the stereographic point u of a ray; with fx, fy, cx, cy at their best straight line, its control
points follow from rays and pixels of ours by one linear solve (https://mrcal.secretsauce.net/lensmodels.html). It is
made finer until it repeats the camera. The camera's frame is the view's, as in the pinhole models of the ``mrcal``
format, so these and the camera stand to each other as they should.
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
"""Control points across, as many as are needed."""

TOLERANCE = 0.01  # px at most between the camera and the spline, at which a finer one is not tried
SAMPLES = 3  # pixels a control point and axis
BORDER = 500  # pixels along the border
WIDEST = np.cos(np.deg2rad(172.0))  # straight behind, the stereographic plane ends


@dataclass(frozen=True, slots=True, eq=False)
class SplinedModel:
    """LENSMODEL_SPLINED_STEREOGRAPHIC: ``core`` (4,) fx, fy, cx, cy px, ``surface`` over u, ``fov_x`` whole degrees.

    ``rms_px`` and ``largest_px`` are its distances to the camera where that may be believed, ``region`` (n, 2) px the
    hull of this part of the image, ``left_out`` the share of the image that is no part of it.
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
        """What a user should know of the fit, and what it leaves out."""
        rows, columns, _ = self.surface.control.shape
        fit = f"{columns}x{rows} control points repeat the camera to {self.rms_px:.2g} px rms"
        sentences = [f"{fit}, {rounded_up(self.largest_px)} px at most, where it may be believed"]
        if self.left_out >= 0.0005:
            sentences.append(
                f"{self.left_out:.1%} of the image may not be believed: the model goes on smoothly there, outside its "
                "valid_intrinsics_region"
            )
        return [*sentences, "the format has no room for standard deviations without mrcal's own optimization inputs"]


def splined_model(export: PinholeExport) -> SplinedModel:
    """The spline of ``export``'s camera; raises CalibrationError where too little of the image may be believed."""
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
        raise CalibrationError("too little of the image may be believed to fit a spline to; allow more with --max-std")
    uv, u = places[seen], stereographic_plane(directions[seen])
    core = _core(u, uv)
    empty, fov_x = _empty(np.abs(u).max(axis=0), columns)
    surface = fitted(empty, u, (uv - core[2:]) / core[:2] - u)
    rms, largest = _errors(export, splined_stereographic(core, surface), columns)
    return SplinedModel(core, surface, fov_x, rms, largest, convex_hull(uv).vertices, 1.0 - share)


def _errors(export: PinholeExport, project: Projection, columns: int) -> tuple[float, float]:
    """Distances of ``project`` to the camera, px, where that may be believed: rms, and the largest of all pixels'."""

    def errors_at(uv: Floats) -> Floats:
        return np.asarray(np.linalg.norm(project(_directions(export, uv)) - uv, axis=1))

    count = SAMPLES * columns + 1  # between the places of the fit
    grid = _grid(export, count)
    errors = errors_at(grid)
    worst = errors_at(worst_places(errors_at, grid, max(export.camera.image_size) / count))
    return float(np.sqrt(np.nanmean(errors**2))), float(max(np.nanmax(errors), np.nanmax(worst)))


def _grid(export: PinholeExport, count: int) -> Floats:
    """Pixels all over the image (n, 2), ``count`` along the longer side."""
    size = export.camera.image_size
    sides = [np.linspace(0.0, n - 1.0, max(8, round(count * n / max(size)))) for n in size]
    return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)


def _border(export: PinholeExport) -> Floats:
    """Pixels (n, 2) along the border of the domain's hull: a spline without data there flies off beyond the grid's."""
    hull = export.camera.domain.hull.vertices
    along = np.linspace(0.0, 1.0, 1 + BORDER // len(hull), endpoint=False)[:, None, None]
    return np.asarray((hull + along * (np.roll(hull, -1, axis=0) - hull)).reshape(-1, 2))


def _directions(export: PinholeExport, uv: Floats) -> Floats:
    """Directions (n, 3) of pixels in the view; nan where they may not be believed, and straight behind."""
    camera, directions = export.camera, np.full((len(uv), 3), np.nan)
    known = valid_pixels(camera, uv, export.max_std)
    directions[known] = camera.chart.directions(camera.plane_map.value(uv[known])) @ export.view.rotation.T
    directions[~(directions[:, 2] > WIDEST)] = np.nan
    return directions


def _core(u: Floats, uv: Floats) -> Floats:
    """fx, fy, cx, cy (4,) of the straight lines through u and pixels; what is left is the spline's."""
    lines = [np.linalg.lstsq(homogeneous(u[:, axis, None]), uv[:, axis], rcond=None)[0] for axis in (0, 1)]
    return np.array(lines).T.ravel()


def _empty(widest: Floats, columns: int) -> tuple[SplineSurface, int]:
    """A surface without content whose patches reach to ``widest`` (2,) from the axis, and its whole degrees across."""
    fov_x = int(np.ceil(np.rad2deg(4.0 * np.arctan(widest[0] / 2.0))))
    spacing, _ = knots(ORDER, columns, columns, fov_x)
    rows = max(ORDER + 1, int(np.ceil(2.0 * widest[1] / spacing)) + ORDER)
    spacing, origin = knots(ORDER, columns, rows, fov_x)
    return SplineSurface(origin, np.full(2, spacing), np.zeros((rows, columns, 2)), ORDER), fov_x


def write(export: PinholeExport, path: Path) -> list[str]:
    """fx, fy, cx, cy and the control points, row by row, x and y of each in turn."""
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


STATEMENT = "A camera calibrated by pinholify, as its own images show it: nothing is to be straightened before."

FORMAT = Format((".cameramodel",), write, of_view=False)
