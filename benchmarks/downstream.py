"""What a calibrated camera is for: pose, triangulation, stereo through the virtual camera and through OpenCV's models.

    python benchmarks/downstream.py [LENS ...]      five lenses of the simulation unless named

A left and a right camera of one lens, two squares apart, see the same 24 noisy boards (0.1 px an axis) and are
calibrated from them by us and by OpenCV. What is measured then has no noise: errors are the cameras' own, root mean
square over three draws of the calibration's noise. Nothing needs a camera's frame: poses are of one board to another,
points in a board's frame, rows between both cameras.

- pose: of a board against the one before, root mean square angle in mrad and distance in thousandths of a square.
- triangulation: points about a board from two views of the left camera, whose poses the board gives; root mean square
  distance to the truth in thousandths of a square.
- rectification: difference of the rows of a point in both rectified images, root mean square in px.

"best" is the best of OpenCV's models, which a user would have to know. Only what lies inside the hull of all corners
that the camera was calibrated from is measured, and within 70° of the axis: a flat image, which OpenCV's fisheye model
needs, grows without bound towards 90°.
"""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import sys
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.board import Checkerboard, lattice
from pinholify.calibration.result import flat
from pinholify.camera import VirtualCamera
from pinholify.corners import Corners, CornerSet
from pinholify.evaluation.baseline import MODELS, BoardPoints, OpenCVCamera, fit_opencv
from pinholify.geometry import Pose, convex_hull
from pinholify.pipeline import calibrate
from pinholify.points import solve_pnp, undistort_points
from pinholify.rectification.views import optical_rotation
from pinholify.simulation.lenses import LENSES
from pinholify.simulation.lenses.base import LensRays
from pinholify.simulation.views import board_poses

NAMED = ("pinhole", "brown-conrady", "unity-barrel", "fisheye", "windscreen")
BOARD = Checkerboard(12, 9)
POINTS = flat(lattice(BOARD))
TRAINING, TESTING = 24, 12
NOISE, DRAWS = 0.1, 3
WIDEST = np.cos(np.deg2rad(70.0))
SCENE = 400
LEFT = Pose(np.eye(3), np.zeros(3))
RIGHT = Pose(Rotation.from_euler("yxz", [-4.0, 1.0, 0.5], degrees=True).as_matrix(), np.array([-2.0, 0.05, 0.03]))
"""The right camera's frame from the left's: two squares beside it, a little turned."""


@dataclass(frozen=True)
class Displaced:
    """A lens elsewhere: its camera frame at ``pose`` from the left camera's."""

    lens: object
    pose: Pose

    @property
    def size(self):
        return self.lens.size

    def project(self, points):
        return self.lens.project(self.pose.apply(points))

    def unproject(self, uv):
        rays = self.lens.unproject(uv)
        origins = (rays.origins - self.pose.translation) @ self.pose.rotation
        return LensRays(origins, rays.directions @ self.pose.rotation)


# --- a camera to measure with: ideal points of pixels, and poses of boards --------------------------------------------


@dataclass(frozen=True)
class Ours:
    camera: VirtualCamera

    def ideal(self, uv, R=None, P=None):
        turn = optical_rotation(self.camera)
        return undistort_points(uv, self.camera, turn if R is None else R @ turn, P)

    def pose(self, uv):
        _, rvec, tvec = solve_pnp(POINTS, uv, self.camera, optical_rotation(self.camera))
        return pose_of(rvec, tvec)


@dataclass(frozen=True)
class Theirs:
    camera: OpenCVCamera

    def ideal(self, uv, R=None, P=None):
        matrix, distortion = self.camera.matrix, self.camera.distortion
        plain = (3, 100, 1e-12)
        if self.camera.model == "fisheye":
            found = cv2.fisheye.undistortPoints(uv[:, None], matrix, distortion, R=R, P=P, criteria=plain)
        elif hasattr(cv2, "undistortPointsIter"):  # OpenCV 4
            found = cv2.undistortPointsIter(uv[:, None], matrix, distortion, R, P, plain)
        else:
            found = cv2.undistortPoints(uv[:, None], matrix, distortion, R=R, P=P, criteria=plain)
        return found[:, 0]

    def pose(self, uv):
        return pose_of(*self.camera.pose(BoardPoints(lattice(BOARD), uv)))


def pose_of(rvec, tvec):
    return Pose(Rotation.from_rotvec(np.ravel(rvec)).as_matrix(), np.ravel(tvec))


def after(second, first):
    """``second`` ∘ inverse of ``first``."""
    rotation = second.rotation @ first.rotation.T
    return Pose(rotation, second.translation - rotation @ first.translation)


def calibrated(model, lens, uv):
    if model == "ours":
        views = tuple(Corners(f"view{i:03d}", np.arange(len(POINTS)), view) for i, view in enumerate(uv))
        return Ours(calibrate(CornerSet(BOARD, lens.size, views), reference="view000", method="joint").camera)
    camera = fit_opencv(model, [BoardPoints(lattice(BOARD), view) for view in uv], lens.size)
    return None if camera is None else Theirs(camera)


# --- the three measures ----------------------------------------------------------------------------------------------


def pose_errors(camera, lens, poses):
    """RMS angle in mrad and distance in thousandths of a square, of each board against the one before."""
    found = [camera.pose(lens.project(pose.apply(POINTS))) for pose in poses]
    angles, distances = [], []
    for i in range(1, len(poses)):
        # In the frame of the earlier board, where the camera's own frame plays no part.
        ours, truth = (between(each[i - 1], each[i]) for each in (found, poses))
        angles.append(Rotation.from_matrix(ours.rotation @ truth.rotation.T).magnitude())
        distances.append(np.linalg.norm(ours.translation - truth.translation))
    return 1e3 * rms(angles), 1e3 * rms(distances)


def between(first, second):
    """The second board in the frame of the first."""
    rotation = first.rotation.T
    return Pose(rotation @ second.rotation, rotation @ (second.translation - first.translation))


def triangulation_error(camera, lens, poses, hull, points):
    """RMS distance in thousandths of a square of ``points`` (n, 3) about a board, seen in pairs of views of it."""
    errors = []
    for one, two in pairwise(poses):
        pixels = [lens.project(pose.apply(points)) for pose in (one, two)]
        seen = visible(lens, one, points, hull) & visible(lens, two, points, hull)
        views = [camera.pose(lens.project(pose.apply(POINTS))) for pose in (one, two)]
        matrices = [np.column_stack([view.rotation, view.translation]) for view in views]
        rays = [camera.ideal(uv[seen]) for uv in pixels]
        found = cv2.triangulatePoints(*matrices, *(ray.T for ray in rays))
        errors.append(np.linalg.norm((found[:3] / found[3]).T - points[seen], axis=1))
    return 1e3 * rms(np.concatenate(errors))


def row_error(left, right, lens, poses, hulls, points):
    """RMS difference of rows in px of ``points`` (n, 3) in the rectified images of both cameras."""
    relative = mean_pose([after(right.pose(there), left.pose(here)) for here, there in both(lens, poses)])
    matrix, none, beside = pinhole_matrix(lens.size), np.zeros(5), relative.translation.reshape(3, 1)
    R1, R2, P1, P2, *_ = cv2.stereoRectify(matrix, none, matrix, none, lens.size, relative.rotation, beside)
    seen = visible(lens, LEFT, points, hulls[0]) & visible(lens, RIGHT, points, hulls[1])
    rows = [
        camera.ideal(other.project(points[seen]), R, P)[:, 1]
        for camera, other, R, P in ((left, lens, R1, P1), (right, Displaced(lens, RIGHT), R2, P2))
    ]
    return rms(rows[0] - rows[1])


def both(lens, poses):
    """Pixels of the boards in the left and in the right camera."""
    right = Displaced(lens, RIGHT)
    return [(lens.project(pose.apply(POINTS)), right.project(pose.apply(POINTS))) for pose in poses]


def mean_pose(poses):
    rotation = Rotation.from_matrix([pose.rotation for pose in poses]).mean().as_matrix()
    return Pose(rotation, np.mean([pose.translation for pose in poses], axis=0))


def pinhole_matrix(size):
    return np.array([[size[0] / 2.0, 0, (size[0] - 1) / 2.0], [0, size[0] / 2.0, (size[1] - 1) / 2.0], [0, 0, 1]])


def visible(lens, pose, points, hull):
    """Which of ``points`` (n, 3) the lens at ``pose`` sees inside ``hull`` and within 70° of its axis."""
    moved = pose.apply(points)
    return hull.contains(lens.project(moved)) & (moved[:, 2] > WIDEST * np.linalg.norm(moved, axis=1))


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


# --- scenes and the table --------------------------------------------------------------------------------------------


def scene(lens):
    """Poses of boards to calibrate from and to measure, seen whole by both cameras, and two clouds of points."""
    right = Displaced(lens, RIGHT)
    training = board_poses([lens, right], BOARD, TRAINING, seed=1)
    others = board_poses([lens, right], BOARD, 4 * TESTING, seed=2)
    hulls = [convex_hull(np.concatenate(side)) for side in zip(*both(lens, training), strict=True)]
    testing = [pose for pose in others if visible(lens, pose, POINTS, hulls[0]).all()]
    rng = np.random.default_rng(3)
    about = rng.uniform([-2.0, -2.0, -4.0], [13.0, 10.0, 2.0], (SCENE, 3))
    across = rng.normal(size=(20 * SCENE, 3)) * rng.uniform(8.0, 40.0, (20 * SCENE, 1))
    return training, testing[:TESTING], hulls, about, across


def measured(model, lens, content, seed):
    training, testing, hulls, about, across = content
    rng = np.random.default_rng(seed)
    true = [np.array(side) for side in zip(*both(lens, training), strict=True)]
    noisy = [side + rng.normal(0.0, NOISE, side.shape) for side in true]
    left, right = (calibrated(model, lens, uv) for uv in noisy)
    if left is None or right is None:
        return None
    triangulated = triangulation_error(left, lens, testing, hulls[0], about)
    return *pose_errors(left, lens, testing), triangulated, row_error(left, right, lens, testing, hulls, across)


def drawn(model, lens, content):
    """All four errors, root mean square over draws of noise; nan where the model cannot be fitted to one of them."""
    results = [measured(model, lens, content, seed) for seed in range(DRAWS)]
    return [np.nan] * 4 if None in results else [rms(each) for each in zip(*results, strict=True)]


def short(number):
    """Three digits, without an exponent."""
    return f"{float(f'{number:.3g}'):g}"


def main(names):
    print("| lens | measure | ours | OpenCV 5 | OpenCV 8 | OpenCV fisheye | ours ÷ best |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    titles = ("pose, mrad", "pose, ‰ square", "triangulation, ‰ square", "rows, px")
    for name in names or NAMED:
        lens = LENSES[name]
        content = scene(lens)
        results = {model: drawn(model, lens, content) for model in ("ours", *MODELS)}
        for i, title in enumerate(titles):
            errors = {model: result[i] for model, result in results.items()}
            ratio = errors["ours"] / np.nanmin([errors[model] for model in MODELS])
            numbers = " | ".join(short(error) for error in errors.values())
            print(f"| {name} | {title} | {numbers} | {ratio:.2g} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
