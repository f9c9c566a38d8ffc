"""Camera calibration without a lens model: any camera becomes a perfect pinhole camera.

The short way from photographs to straight pictures::

    import pinholify

    board = pinholify.parse_board("15x9")
    corners = pinholify.detect_files(["a.jpg", "b.jpg", "c.jpg"], board)
    calibration = pinholify.calibrate(corners)
    straighten = pinholify.Straightener(calibration.camera)
    straight = straighten(pinholify.read_image("a.jpg"))

Names are loaded when they are first used, so importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from pinholify.batch.run import straighten_images
    from pinholify.batch.video import straighten_video, video_job
    from pinholify.board import parse_board
    from pinholify.board.checkerboard import Checkerboard
    from pinholify.calibration.observation import estimate_pose, observe, sighting_of
    from pinholify.calibration.result import Calibration
    from pinholify.camera import Mapped, Rays, VirtualCamera
    from pinholify.charts import Intrinsics
    from pinholify.corners import Corners, CornerSet
    from pinholify.detection import detect_board, detect_files
    from pinholify.errors import PinholifyError
    from pinholify.evaluation.summary import Evaluation, evaluate
    from pinholify.geometry import Pose
    from pinholify.gp.fitting import FittedMap, fit_map
    from pinholify.io.camera_file import read_camera, write_camera
    from pinholify.io.corner_tables import read_corner_table, write_corner_table
    from pinholify.io.images import read_image, write_image
    from pinholify.io.live import straight_frames
    from pinholify.pipeline import calibrate
    from pinholify.rectification.maps import RectificationMap, rectification_map
    from pinholify.rectification.options import ViewOptions
    from pinholify.rectification.straightener import Straightener
    from pinholify.rectification.views import View, named_view

_HOMES = {
    "Calibration": "calibration.result",
    "Checkerboard": "board.checkerboard",
    "CornerSet": "corners",
    "Corners": "corners",
    "Evaluation": "evaluation.summary",
    "FittedMap": "gp.fitting",
    "Intrinsics": "charts",
    "Mapped": "camera",
    "PinholifyError": "errors",
    "Pose": "geometry",
    "Rays": "camera",
    "RectificationMap": "rectification.maps",
    "Straightener": "rectification.straightener",
    "View": "rectification.views",
    "ViewOptions": "rectification.options",
    "VirtualCamera": "camera",
    "calibrate": "pipeline",
    "detect_board": "detection",
    "detect_files": "detection",
    "estimate_pose": "calibration.observation",
    "evaluate": "evaluation.summary",
    "fit_map": "gp.fitting",
    "named_view": "rectification.views",
    "observe": "calibration.observation",
    "parse_board": "board",
    "read_camera": "io.camera_file",
    "read_corner_table": "io.corner_tables",
    "read_image": "io.images",
    "rectification_map": "rectification.maps",
    "sighting_of": "calibration.observation",
    "straight_frames": "io.live",
    "straighten_images": "batch.run",
    "straighten_video": "batch.video",
    "video_job": "batch.video",
    "write_camera": "io.camera_file",
    "write_corner_table": "io.corner_tables",
    "write_image": "io.images",
}

__all__ = [
    "Calibration",
    "Checkerboard",
    "CornerSet",
    "Corners",
    "Evaluation",
    "FittedMap",
    "Intrinsics",
    "Mapped",
    "PinholifyError",
    "Pose",
    "Rays",
    "RectificationMap",
    "Straightener",
    "View",
    "ViewOptions",
    "VirtualCamera",
    "calibrate",
    "detect_board",
    "detect_files",
    "estimate_pose",
    "evaluate",
    "fit_map",
    "named_view",
    "observe",
    "parse_board",
    "read_camera",
    "read_corner_table",
    "read_image",
    "rectification_map",
    "sighting_of",
    "straight_frames",
    "straighten_images",
    "straighten_video",
    "video_job",
    "write_camera",
    "write_corner_table",
    "write_image",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'pinholify' has no attribute '{name}'")
    return getattr(importlib.import_module(f"pinholify.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(["__version__", *__all__])
