"""The pictures of a data set's row in the paper's large figure: one board, straightened in three ways."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pinholify.calibration.observation import ObservedBoard
from pinholify.evaluation.baseline import BoardPoints, OpenCVCamera, fit_opencv
from pinholify.evaluation.heldout import by_size
from pinholify.io.images import read_image
from pinholify.rectification.maps import Image
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.straightener import Straightener
from pinholify.reproduction.chain import Reproduced

MAX_SIDE_PX = 1200  # px; enough for a column of a printed page
SHOWN_STD = 1.0  # px; pixels with a larger standard deviation are left black


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """The ``photograph`` of the example board, straightened by OpenCV and the two calibrations: (h, w) uint8 each.

    ``opencv`` is None if OpenCV's model could not be fitted. ``board`` is the example as the paper's method maps it.
    """

    photograph: Image
    board: ObservedBoard
    opencv: Image | None
    splat: Image
    remap: Image


def picture_row(result: Reproduced) -> Row:
    """The row of ``result``: its example board by OpenCV-5, splat with the constant mean, remap with the default."""
    name = example_board(result)
    files = {path.name: path for path in result.files}
    photograph = read_image(files[name])
    splat = Straightener(result.paper.evaluation.calibration.camera, ViewOptions("board"), method="splat")
    remap = Straightener(result.ours.evaluation.calibration.camera, ViewOptions(max_std=SHOWN_STD))
    camera = fit_opencv("opencv5", _boards(result), result.corner_set.image_size)
    return Row(
        _reduced(photograph),
        result.paper.evaluation.observed[name],
        None if camera is None else _reduced(opencv_undistorted(photograph, camera)),
        _reduced(splat(photograph)),
        _reduced(remap(photograph)),
    )


def example_board(result: Reproduced) -> str:
    """The name of the view with the largest counted board other than the reference."""
    evaluation = result.paper.evaluation
    views = [v for v in by_size(result.corner_set.found) if v.name in evaluation.observed]
    return next(v.name for v in views if v.name != evaluation.calibration.reference)


def opencv_undistorted(image: Image, camera: OpenCVCamera) -> Image:
    """``image`` straightened by OpenCV with its camera matrix unchanged."""
    return np.asarray(cv2.undistort(image, camera.matrix, camera.distortion))


def _boards(result: Reproduced) -> list[BoardPoints]:
    return [BoardPoints(o.board.lattice, o.board.uv) for o in result.paper.evaluation.observed.values()]


def _reduced(image: Image) -> Image:
    factor = min(1.0, MAX_SIDE_PX / max(image.shape[:2]))
    size = (round(image.shape[1] * factor), round(image.shape[0] * factor))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
