"""Calibration of a session in stages: a preview, the camera, and its evaluation.

Each stage reports a complete result, so that pages show numbers and a straightened picture early.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.methods import FEWEST_BOARDS
from pinholify.calibration.result import Calibration
from pinholify.camera import VirtualCamera
from pinholify.corners import CornerSet
from pinholify.errors import CalibrationError, PinholifyError
from pinholify.evaluation.summary import Evaluation, Recalibrate, evaluate
from pinholify.evaluation.verdict import Verdict, cell_centres, coverage, judge, place, residuals_of
from pinholify.io.camera_file import write_camera
from pinholify.io.files import atomic_path, make_folder
from pinholify.io.images import decode_image, read_bytes, write_image
from pinholify.pipeline import FEWEST_FOR_JOINT, calibrate, recalibrate
from pinholify.rectification.maps import RectificationMap, rectification_map, remap
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.views import View, named_view
from pinholify.report.overview import angles_across
from pinholify.report.pictures import eight_bits
from pinholify.web.process_pool import Report

PREVIEW_TREND = "angle:4"  # suits most lenses, and needs no search
PREVIEW_SIDE = 960
GRID = (32, 24)

CAMERA, MAP = "camera.npz", "map.npz"


@dataclass(frozen=True, slots=True, eq=False)
class SolveRequest:
    """A calibration to run on ``corners``; its files are written into ``folder``.

    ``ids`` are the photographs' ids by name of the views. ``trend`` is that of the last result, for the preview;
    ``preview_only`` stops after that.
    """

    corners: CornerSet
    ids: Mapping[str, str]
    square_mm: float | None
    mirrored: bool
    trend: str | None
    preview_only: bool
    folder: Path


def solve(report: Report, request: SolveRequest) -> None:
    """Report the result of every stage as JSON, and write the camera and its map into the folder of ``request``.

    Raises CalibrationError if the corners do not determine a camera.
    """
    corners = request.corners
    if len(corners.found) < FEWEST_BOARDS:
        raise CalibrationError(f"{len(corners.found)} photographs show the board; at least {FEWEST_BOARDS} are needed")
    make_folder(request.folder)
    if len(corners.found) >= FEWEST_FOR_JOINT and _preview(report, request) and request.preview_only:
        return
    calibration = calibrate(corners, mirrored=request.mirrored, square_mm=request.square_mm)
    write_camera(request.folder / CAMERA, calibration)
    insample = _scored(calibration, corners)
    report(_result("camera", request, calibration, insample))
    evaluation = _scored(calibration, corners, partial(recalibrate, calibration)) or insample
    report(_result("evaluated", request, calibration, evaluation, _judged(evaluation, corners)))


def _preview(report: Report, request: SolveRequest) -> bool:
    """Whether a calibration with a fixed trend succeeded; if not, the one with a search will raise the reason."""
    trend = (request.trend or PREVIEW_TREND).partition("+")[0]
    try:
        calibration = calibrate(request.corners, method="joint", mirrored=request.mirrored, trend=trend)
    except PinholifyError:
        return False
    report(_result("first", request, calibration, _scored(calibration, request.corners)))
    return True


def _scored(calibration: Calibration, corners: CornerSet, again: Recalibrate | None = None) -> Evaluation | None:
    """The evaluation, or None if too few boards lie in the camera's domain."""
    try:
        return evaluate(calibration, corners, recalibrate=again, compare_opencv=False)
    except PinholifyError:
        return None


def _judged(evaluation: Evaluation | None, corners: CornerSet) -> Verdict | None:
    try:
        return None if evaluation is None else judge(evaluation, corners)
    except PinholifyError:
        return None


def _result(
    stage: str,
    request: SolveRequest,
    calibration: Calibration,
    evaluation: Evaluation | None,
    verdict: Verdict | None = None,
) -> dict[str, Any]:
    """A result as JSON; the map for straightened pictures is written to the folder."""
    camera = calibration.camera
    write_map(request.folder / MAP, camera)
    focal = focal_px(camera)
    relative = float(calibration.intrinsics_std[0] / camera.intrinsics.f)
    squares = zip(("f", "uc", "vc"), _in_squares(camera), calibration.intrinsics_std, strict=True)
    return {
        "stage": stage,
        "photographs": list(request.ids.values()),
        "f_px": number(focal, 4),
        "f_px_std": number(focal * relative, 6),
        "virtual": {name: [number(value, 6), number(std, 6)] for name, value, std in squares},
        "square_mm": calibration.square_mm,
        "width_degrees": number(angle_across(camera), 2),
        "method": calibration.method,
        "trend": calibration.trend,
        "reference": request.ids[calibration.reference],
        "noise_px": number(camera.noise_px, 4),
        "covered": number(coverage(camera), 4),
        "std_px": std_grid(camera),
        "boards": {} if evaluation is None else _boards(evaluation, request),
        "rms_px": None if evaluation is None else number(evaluation.pooled.re_px, 4),
        "heldout_px": None if evaluation is None else number(evaluation.heldout_px, 4),
        **_verdict(verdict, camera),
    }


def _verdict(verdict: Verdict | None, camera: VirtualCamera) -> dict[str, Any]:
    if verdict is None:
        return {"level": None, "sentence": None, "findings": None, "next": None}
    advice = verdict.next_board
    return {
        "level": verdict.level,
        "sentence": replace(verdict, advice=None).sentence,  # the page shows the advice as an outline
        "findings": [verdict.headline, *verdict.reasons],
        "next": advice
        and {
            "place": place(advice, camera.image_size),
            "outline": advice.outline.round(1).tolist(),
            "gain": number(1.0 - advice.std_after / advice.std_before, 3),
        },
    }


def _boards(evaluation: Evaluation, request: SolveRequest) -> dict[str, Any]:
    """For each photograph: whether its board counts, why not, its RMS error and the residuals of its corners, px."""
    residuals = residuals_of(evaluation, request.corners).residuals
    boards = {}
    for board in evaluation.boards:
        each = residuals.get(board.file)
        boards[request.ids[board.file]] = {
            "used": board.used,
            "reason": board.reason,
            "rms_px": None if each is None else number(float(np.sqrt(np.nanmean((each**2).sum(axis=1)))), 4),
            "residuals": None if each is None else [[number(float(v), 3) for v in pair] for pair in each],
        }
    return boards


def _in_squares(camera: VirtualCamera) -> tuple[float, float, float]:
    """f, uc, vc in squares."""
    k = camera.intrinsics
    return k.f, k.uc, k.vc


def focal_px(camera: VirtualCamera) -> float:
    """Focal length at the centre of the image in px per radian, the geometric mean over all directions."""
    middle = _middle(camera)
    q = camera.plane_map.value(middle)
    turning = (camera.chart.direction_jacobian(q) @ camera.plane_map.jacobian(middle))[0]
    return float(1.0 / np.sqrt(np.prod(np.linalg.svd(turning, compute_uv=False))))


def angle_across(camera: VirtualCamera) -> float:
    """Horizontal field of view in degrees: the angle between the left and right borders by way of the centre."""
    middle = _middle(camera)
    ends = np.array([[[0.0, middle[0, 1]], [camera.image_size[0] - 1.0, middle[0, 1]]]])
    return float(angles_across(camera, ends, middle)[0])


def _middle(camera: VirtualCamera) -> Floats:
    """The image's centre (1, 2) px, or that of the domain if the image's is outside it."""
    middle = (np.array([camera.image_size], dtype=float) - 1.0) / 2.0
    return middle if camera.inside(middle)[0] else camera.domain.hull.vertices.mean(axis=0, keepdims=True)


def std_grid(camera: VirtualCamera) -> dict[str, Any]:
    """The standard deviation of the map in px at the centres of equal cells of the image, row by row."""
    columns, rows = GRID
    std = camera.shape_std(cell_centres(camera.image_size, columns, rows))
    return {"columns": columns, "rows": rows, "values": [number(float(value), 4) for value in std]}


def number(value: float | None, digits: int) -> float | None:
    """``value`` rounded, None if it is not finite, since JSON has no nan."""
    return None if value is None or not np.isfinite(value) else round(float(value), digits)


# --- straight pictures ---


def write_map(path: Path, camera: VirtualCamera) -> None:
    """Write the rectification map for the straightened pictures of pages to ``path``."""
    width, height = camera.image_size
    scale = min(1.0, PREVIEW_SIDE / max(width, height))
    view = named_view(camera, ViewOptions(size=(max(2, round(width * scale)), max(2, round(height * scale)))))
    made = rectification_map(camera, view)
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, uv=made.uv, valid=made.valid, matrix=view.matrix, rotation=view.rotation)


def straighten(original: Path, map_file: Path, target: Path, pixels: int) -> None:
    """Straighten the photograph ``original`` with the map in ``map_file`` and write it to ``target``."""
    with np.load(map_file, allow_pickle=False) as data:
        height, width = data["valid"].shape
        made = RectificationMap(View(data["matrix"], data["rotation"], (width, height)), data["uv"], data["valid"])
    write_image(target, eight_bits(remap(decode_image(read_bytes(original), original.name, max_pixels=pixels), made)))
