"""The demo: a rendered scene with strong distortion, calibrated from its photographs and straightened."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.calibration.observation import ObservedBoard
from pinholify.calibration.result import Calibration
from pinholify.corners import CornerSet
from pinholify.detection import detect_files
from pinholify.evaluation.measures import board_lines, line_feet
from pinholify.evaluation.summary import Evaluation, evaluate
from pinholify.evaluation.verdict import Verdict, judge
from pinholify.io.camera_file import write_camera
from pinholify.io.corner_tables import write_corner_table
from pinholify.io.files import make_folder, writing_text
from pinholify.io.images import read_image, write_image
from pinholify.pipeline import calibrate, recalibrate
from pinholify.rectification.maps import Image
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.straightener import Straightener
from pinholify.simulation.demo import DEMO, street

SHOWN_STD = 1.0  # px; pixels with a larger standard deviation are left black
ABOUT = "ABOUT.txt"
"""A description of the folder's contents; written first, it marks the folder as the demo's."""

ABOUT_TEXT = f"""Written by 'pinholify demo'. All photographs are rendered. Lens: {DEMO.title.lower()}.

before-after.jpg    a street as photographed, and straightened
board.jpg           the reference board with its corners, and in the virtual plane
collinearity.jpg    all boards in the virtual plane, where rows and columns are straight lines
photographs/        the photographs of the board
street.jpg          the street as photographed
street-straight.png the street straightened; black where the camera is not known well enough
corners.vnl         the detected corners
camera.npz          the camera; try: pinholify undistort camera.npz street.jpg -o straight/
numbers.json        its errors
"""

RED, GREEN = (60, 60, 230), (80, 190, 60)
COLOURS = ((60, 60, 230), (200, 110, 30), (70, 170, 50), (20, 150, 230))  # one per board


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """The result of the demo; ``intrinsics_error`` is the largest error of f, uc, vc in squares."""

    folder: Path
    evaluation: Evaluation
    verdict: Verdict
    intrinsics_error: float


def run_demo(folder: Path, step: Callable[[str], object] = lambda _: None) -> Demo:
    """Render, detect, calibrate, evaluate and straighten into ``folder``; ``step`` is called with each step's name.

    Raises OutputError where the folder cannot be written.
    """
    photographs = make_folder(folder / "photographs")
    with writing_text(folder / ABOUT) as file:
        file.write(ABOUT_TEXT)
    step(f"Rendering {DEMO.views} photographs of a board, and a street, through {DEMO.title.lower()}")
    paths = []
    for picture in DEMO.photographs():
        paths.append(photographs / f"{picture.name}.jpg")
        write_image(paths[-1], picture.image)
    scene = np.ascontiguousarray(street()[:, :, ::-1])
    write_image(folder / "street.jpg", scene)
    step("Finding the board's corners")
    corners = detect_files(paths, DEMO.board)
    write_corner_table(folder / "corners.vnl", corners)
    step("Calibrating")
    calibration = calibrate(corners, reference=corners.views[0].name)
    write_camera(folder / "camera.npz", calibration)
    step("Scoring it and OpenCV's models on the same corners")
    evaluation = evaluate(calibration, corners, recalibrate=partial(recalibrate, calibration))
    step("Straightening")
    _write_pictures(folder, photographs, scene, calibration, evaluation)
    error = _intrinsics_error(calibration)
    with writing_text(folder / "numbers.json") as file:
        json.dump(_numbers(evaluation, error), file, indent=2)
    return Demo(folder, evaluation, judge(evaluation, corners), error)


def _intrinsics_error(calibration: Calibration) -> float:
    k, truth = calibration.camera.intrinsics, DEMO.truth().virtual_camera
    assert truth is not None  # the demo's lens is central
    return float(np.abs(np.array([k.f, k.uc, k.vc]) - truth).max())


def _numbers(evaluation: Evaluation, intrinsics_error: float) -> dict[str, Any]:
    k = evaluation.calibration.camera.intrinsics
    return {
        "method": evaluation.calibration.method,
        "trend": evaluation.calibration.trend,
        "f": k.f,
        "uc": k.uc,
        "vc": k.vc,
        "largest_error_of_f_uc_vc_squares": intrinsics_error,
        "collinearity_error": evaluation.pooled.ce,
        "reprojection_error_percent": evaluation.pooled.re_refined_percent,
        "heldout_px": evaluation.heldout_px,
        "opencv_heldout_px": {name: score.heldout_px for name, score in evaluation.opencv.items()},
    }


# --- pictures ---------------------------------------------------------------------------------------------------


def _write_pictures(
    folder: Path, photographs: Path, scene: Image, calibration: Calibration, evaluation: Evaluation
) -> None:
    straighten = Straightener(calibration.camera, ViewOptions(max_std=SHOWN_STD))
    straight = straighten(scene)
    write_image(folder / "street-straight.png", straight)
    both = side_by_side(scene, straight, "as photographed", "as a pinhole camera sees it")
    write_image(folder / "before-after.jpg", both)
    reference = _in_colour(read_image(photographs / calibration.reference))
    board_view = Straightener(calibration.camera, ViewOptions("board", max_std=SHOWN_STD))
    flat = board_view(reference)
    write_image(
        folder / "board.jpg",
        side_by_side(
            draw_lattice(reference, calibration.corner_set, calibration.reference),
            flat,
            "the reference board and its corners",
            "the virtual plane: a perfect square lattice",
        ),
    )
    write_image(folder / "collinearity.jpg", _collinearity_picture(evaluation))


def _in_colour(image: Image) -> Image:
    return image if image.ndim == 3 else np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))


def side_by_side(before: Image, after: Image, before_text: str, after_text: str) -> Image:
    """Two pictures side by side at the height of ``before``, with captions."""
    height = before.shape[0]
    after = cv2.resize(after, (round(after.shape[1] * height / after.shape[0]), height), interpolation=cv2.INTER_AREA)
    parts = [_captioned(_in_colour(p), t) for p, t in ((before, before_text), (after, after_text))]
    return np.hstack([parts[0], np.full((parts[0].shape[0], 12, 3), 255, np.uint8), parts[1]])


def _captioned(picture: Image, text: str) -> Image:
    bar = np.full((64, picture.shape[1], 3), 255, np.uint8)
    cv2.putText(bar, text, (14, 44), cv2.FONT_HERSHEY_DUPLEX, 1.1, (40, 40, 40), 2, cv2.LINE_AA)
    return np.vstack([bar, picture])


def draw_lattice(image: Image, corners: CornerSet, name: str) -> Image:
    """``image`` with the corners of the view called ``name`` and the lines of their lattice."""
    view = next(v for v in corners.views if v.name == name)
    drawn = np.array(_in_colour(image))
    for line in board_lines(view.lattice(corners.board), view.uv):
        _polyline(drawn, line, GREEN, 2)
    for u, v in view.uv:
        cv2.circle(drawn, (round(u), round(v)), 6, RED, 2, cv2.LINE_AA)
    return drawn


def _polyline(image: NDArray[Any], points: NDArray[np.float64], colour: tuple[int, int, int], width: int) -> None:
    path = np.round(points * 16).astype(np.int32)[:, None]
    cv2.polylines(image, [path], False, colour, width, cv2.LINE_AA, shift=4)


def _collinearity_picture(evaluation: Evaluation, most: tuple[int, int] = (1280, 960)) -> Image:
    """The first few boards in the virtual plane, with the lines fitted to their rows and columns."""
    boards = list(evaluation.observed.values())[: len(COLOURS)]
    points = np.concatenate([o.board.xy for o in boards])
    low, high = points.min(axis=0), points.max(axis=0)
    scale = float(((np.array(most) - 80) / (high - low)).min())
    width, height = np.ceil((high - low) * scale).astype(int) + 80
    picture = np.full((height, width, 3), 255, np.uint8)
    for observed, colour in zip(boards, COLOURS, strict=False):
        _draw_board_lines(picture, observed, colour, lambda xy: (xy - low) * scale + 40.0)
    counted, error = len(evaluation.observed), evaluation.pooled.ce * 1e4
    text = f"{len(boards)} of {counted} boards in the virtual plane; CE of all {error:.2f}e-4"
    return _captioned(picture, text)


def _draw_board_lines(
    picture: NDArray[Any],
    observed: ObservedBoard,
    colour: tuple[int, int, int],
    place: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> None:
    for line in board_lines(observed.board.lattice, place(observed.board.xy)):
        _polyline(picture, line_feet(line)[[0, -1]], (200, 200, 200), 1)
    for x, y in place(observed.board.xy):
        cv2.circle(picture, (round(x * 16), round(y * 16)), 56, colour, -1, cv2.LINE_AA, shift=4)
