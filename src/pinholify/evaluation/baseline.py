"""OpenCV's camera models fitted to the same corners, for comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pinholify.arrays import Floats

# OpenCV 5 moved cv2.fisheye.CALIB_* to cv2.CALIB_* and gave them other values.
_HOME = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2
FISHEYE_FLAGS = _HOME.CALIB_RECOMPUTE_EXTRINSIC | _HOME.CALIB_FIX_SKEW
PINHOLE_FLAGS = {"opencv5": 0, "opencv8": cv2.CALIB_RATIONAL_MODEL}
MODELS = (*PINHOLE_FLAGS, "fisheye")


@dataclass(frozen=True, slots=True, eq=False)
class BoardPoints:
    """A board's corners: ``lattice`` (n, 2) squares and ``uv`` (n, 2) px."""

    lattice: Floats
    uv: Floats

    @property
    def solid(self) -> Floats:
        """Lattice points with z = 0, (n, 3)."""
        return np.concatenate([self.lattice, np.zeros((len(self.lattice), 1))], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class OpenCVCamera:
    """A camera of one of OpenCV's ``MODELS``: its ``matrix`` (3, 3) in px and ``distortion`` coefficients."""

    model: str
    matrix: Floats
    distortion: Floats

    def residuals(self, board: BoardPoints) -> Floats | None:
        """Reprojection residuals (n, 2) px with only the pose refitted; None where OpenCV finds no pose."""
        try:
            rotation, translation = self.pose(board)
            if self.model == "fisheye":
                seen, _ = cv2.fisheye.projectPoints(
                    board.solid[:, None], rotation, translation, self.matrix, self.distortion
                )
            else:
                seen, _ = cv2.projectPoints(board.solid, rotation, translation, self.matrix, self.distortion)
        except cv2.error:
            return None
        return np.asarray(seen[:, 0] - board.uv)

    def pose(self, board: BoardPoints) -> tuple[Floats, Floats]:
        """The rvec and tvec (3, 1) of a board: a solve on undistorted points, refined by least squares in px."""
        rays = self._normalised(board.uv)
        _, rotation, translation = cv2.solvePnP(board.solid, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
        if self.model != "fisheye":
            return cv2.solvePnPRefineLM(
                board.solid, board.uv, self.matrix, self.distortion, rotation, translation, (3, 100, 1e-12)
            )
        return _refine_fisheye_pose(self, board, rotation, translation)

    def _normalised(self, uv: Floats) -> Floats:
        undistort = cv2.fisheye.undistortPoints if self.model == "fisheye" else cv2.undistortPoints
        return np.asarray(undistort(uv[:, None], self.matrix, self.distortion)[:, 0])


def _refine_fisheye_pose(
    camera: OpenCVCamera, board: BoardPoints, rotation: Floats, translation: Floats
) -> tuple[Floats, Floats]:
    """Least squares by SciPy on OpenCV's projection: OpenCV 4 has no pose refinement for its fisheye model."""
    from scipy.optimize import least_squares

    def residual(pose: Floats) -> Floats:
        seen, _ = cv2.fisheye.projectPoints(board.solid[:, None], pose[:3], pose[3:], camera.matrix, camera.distortion)
        return np.asarray((seen[:, 0] - board.uv).ravel())

    pose = least_squares(residual, np.concatenate([rotation.ravel(), translation.ravel()]), x_scale="jac").x
    return pose[:3].copy(), pose[3:].copy()


def fit_opencv(model: str, boards: Sequence[BoardPoints], image_size: tuple[int, int]) -> OpenCVCamera | None:
    """OpenCV's ``model`` (one of ``MODELS``) fitted to ``boards``; None where OpenCV fails or diverges."""
    try:
        if model == "fisheye":
            matrix, distortion = _fit_fisheye(boards, image_size)
        else:
            lattices = [b.solid.astype(np.float32) for b in boards]
            pixels = [b.uv.astype(np.float32)[:, None] for b in boards]
            _, matrix, distortion, *_ = cv2.calibrateCamera(
                lattices, pixels, image_size, None, None, flags=PINHOLE_FLAGS[model]
            )
    except cv2.error:
        return None
    return OpenCVCamera(model, matrix, distortion) if np.isfinite(matrix).all() else None


def _fit_fisheye(boards: Sequence[BoardPoints], image_size: tuple[int, int]) -> tuple[Floats, Floats]:
    matrix, distortion = np.eye(3), np.zeros((4, 1))
    cv2.fisheye.calibrate(
        [b.solid[None] for b in boards],
        [b.uv[None] for b in boards],
        image_size,
        matrix,
        distortion,
        flags=FISHEYE_FLAGS,
    )
    return matrix, distortion
