"""From a session's corners to a camera, in stages: a first look, the camera, and how good it is.

Each stage says a whole result, so that a page shows numbers and a straight picture early and better ones as they come.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.result import Calibration
from pinholify.camera import VirtualCamera
from pinholify.corners import CornerSet
from pinholify.errors import CalibrationError, PinholifyError
from pinholify.evaluation.summary import Evaluation, evaluate
from pinholify.evaluation.verdict import Verdict, coverage, judge, place, residuals_of
from pinholify.io.camera_file import write_camera
from pinholify.io.files import atomic_path, make_folder
from pinholify.io.images import decode_image, read_bytes, write_image
from pinholify.pipeline import FEWEST_FOR_JOINT, calibrate
from pinholify.rectification.maps import RectificationMap, rectification_map, remap
from pinholify.rectification.views import View, named_view
from pinholify.report.pictures import eight_bits
from pinholify.web.work import Say

FIRST_LOOK = "angle:4"  # a trend that suits most lenses, to be solved at once while the best one is not known
FEWEST_BOARDS = 3
PREVIEW_SIDE = 960
GRID = (32, 24)

CAMERA, MAP = "camera.npz", "map.npz"


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What is to be solved: ``corners``, whose views are the photographs ``ids`` by name, in ``folder``.

    ``trend`` is that of the last result, for the first look; ``only_first`` stops after that.
    """

    corners: CornerSet
    ids: Mapping[str, str]
    square_mm: float | None
    mirrored: bool
    trend: str | None
    only_first: bool
    folder: Path


def solve(say: Say, question: Question) -> None:
    """Say the result of every stage, as JSON; the camera and its map are written into the question's folder.

    Raises CalibrationError where the corners do not determine a camera.
    """
    corners = question.corners
    if len(corners.found) < FEWEST_BOARDS:
        raise CalibrationError(f"{len(corners.found)} photographs show the board; at least {FEWEST_BOARDS} are needed")
    make_folder(question.folder)
    again = partial(calibrate, mirrored=question.mirrored)
    if len(corners.found) >= FEWEST_FOR_JOINT and _first_look(say, question) and question.only_first:
        return
    calibration = _solved(partial(again, corners, square_mm=question.square_mm))
    write_camera(question.folder / CAMERA, calibration)
    insample = _scored(calibration, corners)
    say(_told("camera", question, calibration, insample))
    method = partial(again, method=calibration.method)
    evaluation = _scored(calibration, corners, lambda part, name: method(part, reference=name)) or insample
    say(_told("evaluated", question, calibration, evaluation, _judged(evaluation, corners)))


def _first_look(say: Say, question: Question) -> bool:
    """Whether there is a result with a trend that needs no search; where there is none, the search will tell why."""
    trend = (question.trend or FIRST_LOOK).partition("+")[0]
    try:
        calibration = _solved(partial(calibrate, question.corners, mirrored=question.mirrored, trend=trend))
    except PinholifyError:
        return False
    say(_told("first", question, calibration, _scored(calibration, question.corners)))
    return True


def _solved(calibrating: Any) -> Calibration:
    try:
        calibration: Calibration = calibrating()
    except np.linalg.LinAlgError:
        raise CalibrationError(
            "the corners lead to equations without a solution; add boards that are tilted in other ways"
        ) from None
    return calibration


def _scored(calibration: Calibration, corners: CornerSet, recalibrate: Any = None) -> Evaluation | None:
    """The evaluation, or None while too few boards lie where the camera may be believed."""
    try:
        return evaluate(calibration, corners, recalibrate=recalibrate, compare_opencv=False)
    except (PinholifyError, np.linalg.LinAlgError):
        return None


def _judged(evaluation: Evaluation | None, corners: CornerSet) -> Verdict | None:
    try:
        return None if evaluation is None else judge(evaluation, corners)
    except np.linalg.LinAlgError:
        return None


def _told(
    stage: str,
    question: Question,
    calibration: Calibration,
    evaluation: Evaluation | None,
    verdict: Verdict | None = None,
) -> dict[str, Any]:
    """A result as JSON; the map of its straight pictures is written."""
    camera = calibration.camera
    write_map(question.folder / MAP, camera)
    focal = focal_px(camera)
    relative = float(calibration.intrinsics_std[0] / camera.intrinsics.f)
    squares = zip(("f", "uc", "vc"), _in_squares(camera), calibration.intrinsics_std, strict=True)
    return {
        "stage": stage,
        "photographs": list(question.ids.values()),
        "f_px": number(focal, 4),
        "f_px_std": number(focal * relative, 6),
        "virtual": {name: [number(value, 6), number(std, 6)] for name, value, std in squares},
        "square_mm": calibration.square_mm,
        "width_degrees": number(angle_across(camera), 2),
        "method": calibration.method,
        "trend": calibration.trend,
        "reference": question.ids[calibration.reference],
        "noise_px": number(camera.noise_px, 4),
        "covered": number(coverage(camera), 4),
        "std_px": _std_grid(camera),
        "boards": {} if evaluation is None else _boards(evaluation, question),
        "rms_px": None if evaluation is None else number(evaluation.pooled.re_px, 4),
        "heldout_px": None if evaluation is None else number(evaluation.heldout_px, 4),
        **_verdict(verdict, camera),
    }


def _verdict(verdict: Verdict | None, camera: VirtualCamera) -> dict[str, Any]:
    if verdict is None:
        return {"level": None, "sentence": None, "next": None}
    advice = verdict.next_board
    judged, gain, _ = verdict.sentence.partition("; to gain most")  # which the page says with an outline
    return {
        "level": verdict.level,
        "sentence": f"{judged}." if gain else judged,
        "next": advice
        and {
            "place": place(advice, camera.image_size),
            "outline": advice.outline.round(1).tolist(),
            "gain": number(1.0 - advice.std_after / advice.std_before, 3),
        },
    }


def _boards(evaluation: Evaluation, question: Question) -> dict[str, Any]:
    """Of each photograph: whether it counts, why not, its RMS error, and residuals beside its corners, px."""
    residuals = residuals_of(evaluation, question.corners).residuals
    told = {}
    for board in evaluation.boards:
        each = residuals.get(board.file)
        told[question.ids[board.file]] = {
            "used": board.used,
            "reason": board.reason,
            "rms_px": None if each is None else number(float(np.sqrt(np.nanmean((each**2).sum(axis=1)))), 4),
            "residuals": None if each is None else [[number(float(v), 3) for v in pair] for pair in each],
        }
    return told


def _in_squares(camera: VirtualCamera) -> tuple[float, float, float]:
    """f, uc, vc in squares."""
    k = camera.intrinsics
    return k.f, k.uc, k.vc


def focal_px(camera: VirtualCamera) -> float:
    """Focal length in the middle of the image: px per radian, the geometric mean of all directions there."""
    middle = _middle(camera)
    q = camera.plane_map.value(middle)
    turning = (camera.chart.direction_jacobian(q) @ camera.plane_map.jacobian(middle))[0]
    return float(1.0 / np.sqrt(np.prod(np.linalg.svd(turning, compute_uv=False))))


def angle_across(camera: VirtualCamera) -> float:
    """Angle in degrees between the rays of the middles of the left and right borders, by way of the image's middle."""
    middle = _middle(camera)
    ends = np.array([[0.0, middle[0, 1]], [camera.image_size[0] - 1.0, middle[0, 1]]])
    left, right, centre = camera.to_rays(np.concatenate([ends, middle])).directions
    return float(np.degrees(sum(np.arccos(np.clip(centre @ side, -1, 1)) for side in (left, right))))


def _middle(camera: VirtualCamera) -> Floats:
    """The image's middle (1, 2), or that of the domain where the camera does not know it."""
    middle = (np.array([camera.image_size], dtype=float) - 1.0) / 2.0
    return middle if camera.inside(middle)[0] else camera.domain.hull.vertices.mean(axis=0, keepdims=True)


def _std_grid(camera: VirtualCamera) -> dict[str, Any]:
    """How well the map is known over the image, px, row by row."""
    columns, rows = GRID
    width, height = camera.image_size
    u, v = (np.arange(columns) + 0.5) / columns * width, (np.arange(rows) + 0.5) / rows * height
    std = camera.shape_std(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    return {"columns": columns, "rows": rows, "values": [number(float(value), 4) for value in std]}


def number(value: float | None, digits: int) -> float | None:
    """``value`` rounded, None where it does not exist: JSON knows no nan."""
    return None if value is None or not np.isfinite(value) else round(float(value), digits)


# --- straight pictures ---


def write_map(path: Path, camera: VirtualCamera) -> None:
    """The map of ``camera``'s straight pictures for pages."""
    width, height = camera.image_size
    scale = min(1.0, PREVIEW_SIDE / max(width, height))
    view = named_view(camera, "camera", (max(2, round(width * scale)), max(2, round(height * scale))), None)
    made = rectification_map(camera, view)
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, uv=made.uv, valid=made.valid, matrix=view.matrix, rotation=view.rotation)


def straighten(say: Say, original: Path, map_file: Path, target: Path, pixels: int) -> None:
    """Write the straight picture of the photograph ``original``."""
    with np.load(map_file, allow_pickle=False) as data:
        height, width = data["valid"].shape
        made = RectificationMap(View(data["matrix"], data["rotation"], (width, height)), data["uv"], data["valid"])
    write_image(target, eight_bits(remap(decode_image(read_bytes(original), original.name, max_pixels=pixels), made)))
