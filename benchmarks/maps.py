"""4K maps and a million points against OpenCV, mrcal and lensboy: times as ratios and errors, in one run.

    python benchmarks/maps.py [--mrcal PYTHON] [--lensboy PYTHON] [LENS ...]

LENS are those of the simulation, six of them unless named, at three times their resolution. Each is calibrated from
noisy corners of 24 boards, and the inverse map of a 3840x2160 view is built: "cold" for a camera that was just read,
nothing prepared, "warm" for one that has had another view before. Errors are the largest distance, px,
from the exact inverse, over random pixels, the picture's four edges, and pixels where validity ends. Points are also
those of the paper's camera, made from one image: "cold" for a camera that was just read, whose table is not made yet,
"warm" for one that has it. Times are the best of several, on the wall. Threads are as many as OpenCV and NumPy's BLAS
choose; OPENBLAS_NUM_THREADS=1 holds our matrix products to one.

PYTHON are interpreters in which mrcal and lensboy are installed; they build the map of a 4K spline model of their own,
float32 for lensboy and float64 for mrcal as they come, and time themselves.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from pinholify.board import Checkerboard
from pinholify.corners import Corners, CornerSet
from pinholify.io.camera_file import read_camera, write_camera
from pinholify.pipeline import calibrate
from pinholify.points import undistort_points, undistort_points_jacobian
from pinholify.rectification.maps import inverse_map, rectification_map, sampler
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.views import named_view
from pinholify.simulation.lenses import LENSES, Resized
from pinholify.simulation.views import board_poses, true_corners

DEFAULT = ("pinhole", "unity-barrel", "unity-pincushion", "rational-prism-tilt", "fisheye", "windscreen")
SIZE = (3840, 2160)
METHODS = ("joint", "one-image")
BOARD = Checkerboard(12, 9)
BOARDS, NOISE, REPEATS, POINTS = 24, 0.1, 7, 1_000_000
MATRIX = np.array([[2000.0, 0.0, 1919.5], [0.0, 2000.0, 1079.5], [0.0, 0.0, 1.0]])
RATIONAL = np.array([-0.25, 0.08, 0.001, -0.001, -0.01, 0.02, 0.01, -0.003])
KANNALA_BRANDT = np.array([0.02, -0.008, 0.001, 0.0])
TO_CONVERGENCE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-10)

TIMED = """
import time
best = 1e9
for _ in range(3):
    start = time.perf_counter()
    build()
    best = min(best, time.perf_counter() - start)
print(best)
"""
MRCAL = f"""
import mrcal, numpy as np
name = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=10_fov_x_deg=100"
count = mrcal.lensmodel_num_params(name)
values = np.r_[2000.0, 2000.0, 1919.5, 1079.5, np.random.default_rng(0).normal(0.0, 1e-4, count - 4)]
model = mrcal.cameramodel(intrinsics=(name, values), imagersize={SIZE})
pinhole = mrcal.cameramodel(intrinsics=("LENSMODEL_PINHOLE", values[:4]), imagersize={SIZE})
build = lambda: mrcal.image_transformation_map(model, pinhole, intrinsics_only=True)
"""
LENSBOY = f"""
import numpy as np
from lensboy import PinholeSplined
dx, dy = np.random.default_rng(0).normal(0.0, 1e-4, (2, 10, 16))
focal, centre = (2000.0, 2000.0), (1919.5, 1079.5)
build = PinholeSplined(*{SIZE}, *focal, *centre, dx, dy, 16, 10, 100.0, 70.0).get_pinhole_model
"""


def seconds(function, *arguments):
    start = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - start


def peer_seconds(python, program):
    """Seconds that a peer's map takes in its own interpreter; None, said why, where it has none."""
    done = subprocess.run([python, "-c", program + TIMED], capture_output=True, text=True, check=False, timeout=600)
    if done.returncode:
        print(f"left out: {done.stderr.strip().splitlines()[-1]}")
        return None
    return float(done.stdout)


def rational():
    return cv2.initUndistortRectifyMap(MATRIX, RATIONAL, np.eye(3), MATRIX, SIZE, cv2.CV_32FC1)


def fisheye():
    return cv2.fisheye.initUndistortRectifyMap(MATRIX, KANNALA_BRANDT, np.eye(3), MATRIX, SIZE, cv2.CV_32FC1)


def calibrated(name, method):
    width, height = LENSES[name].size
    lens = Resized(LENSES[name], (3 * width, 3 * height))
    rng, ids = np.random.default_rng(0), np.arange(BOARD.columns * BOARD.rows)
    views = []
    for i, pose in enumerate(board_poses([lens], BOARD, BOARDS, seed=1)):
        uv = true_corners(lens, BOARD, pose)
        views.append(Corners(f"view{i:03d}", ids, uv + rng.normal(0.0, NOISE, uv.shape)))
    return calibrate(CornerSet(BOARD, lens.size, tuple(views)), reference="view000", method=method)


def checked_pixels(valid):
    """Pixels (n, 2) at random, on all edges of the picture, and where validity begins."""
    height, width = valid.shape
    rng, x, y = np.random.default_rng(0), np.arange(0, width, 7), np.arange(0, height, 7)
    edges = [np.column_stack([x, np.full(len(x), end)]) for end in (0, height - 1)]
    edges += [np.column_stack([np.full(len(y), end), y]) for end in (0, width - 1)]
    border = valid & ~cv2.erode(valid.view(np.uint8), np.ones((3, 3))).view(bool)
    outline = np.argwhere(border)[:: max(1, border.sum() // 2000), ::-1]
    return np.concatenate([rng.integers(0, [width, height], (10_000, 2)), *edges, outline])


def largest_error(camera, view, made):
    pixels = checked_pixels(made.valid)
    exact = camera.project(view.directions(pixels.astype(np.float64)))
    error = np.linalg.norm(made.uv[pixels[:, 1], pixels[:, 0]] - exact, axis=1)
    return float(np.nanmax(error[made.valid[pixels[:, 1], pixels[:, 0]]]))


def compare_maps(path, peers):
    """Prints our times as multiples of the others', taken in turns, and the largest error; the camera and its map."""
    view = named_view(read_camera(path).camera, ViewOptions(size=SIZE))
    camera = read_camera(path).camera
    made = rectification_map(camera, view)
    rounds = [[*our_seconds(path, camera, view), seconds(rational), seconds(fisheye)] for _ in range(2 * REPEATS)]
    *ours, first, second = np.min(rounds, axis=0)
    error = largest_error(camera, view, made)
    print(f"  map: largest error {error:.4f} px; ours ÷ theirs, cold, warm, cold with validity, warm with validity")
    for name, taken in {"OpenCV rational": first, "OpenCV fisheye": second, **peers}.items():
        print(f"    {name:16}" + "".join(f"{own / taken:8.3f}" for own in ours))
    return camera, made


def our_seconds(path, camera, view):
    """Both coordinates alone, as OpenCV gives them, cold and warm; with the mask of what is valid, cold and warm."""
    alone, whole = read_camera(path).camera, read_camera(path).camera
    yield from (seconds(inverse_map, c, view) for c in (alone, camera))
    yield from (seconds(rectification_map, c, view) for c in (whole, camera))


def compare_frames(camera, made):
    """The time of a straightened 4K frame over cv2.remap's alone, for both kinds of map."""
    frame = np.random.default_rng(0).integers(0, 256, (*camera.image_size[::-1], 3), dtype=np.uint8)
    ratios = []
    for fixed in (False, True):
        ours = sampler(made, camera.image_size, fixed_point=fixed)
        pairs = [(seconds(ours, frame), seconds(bare, frame, ours)) for _ in range(3 * REPEATS)]
        ratios.append(float(np.divide(*np.min(pairs, axis=0))))
    print(f"  frame, ours ÷ cv2.remap alone: float {ratios[0]:.2f}, fixed point {ratios[1]:.2f}")


def bare(frame, ours):
    return cv2.remap(frame, ours.map1, ours.map2, cv2.INTER_CUBIC)


def converged(uv):
    return cv2.undistortPoints(uv, MATRIX, RATIONAL, criteria=TO_CONVERGENCE)


def compare_points(path, method):
    """A million points, with the making of the table and once there is one, against cv2.undistortPoints, in turns."""
    rng, camera, rounds = np.random.default_rng(0), read_camera(path).camera, []
    theirs = rng.uniform(-0.5, np.array(SIZE) - 0.5, (POINTS, 2))
    uv = rng.uniform(-0.5, np.array(camera.image_size) - 0.5, (POINTS, 2))
    undistort_points(uv, camera)
    for _ in range(REPEATS):
        fresh = read_camera(path).camera
        rounds.append([seconds(converged, theirs), *(seconds(undistort_points, uv, c) for c in (fresh, camera))])
    best_of_theirs, *ours = np.min(rounds, axis=0)
    cold, warm = np.divide(best_of_theirs, ours)
    some = uv[:10_000]
    wrong = undistort_points(uv, camera)[:10_000] - undistort_points(some, camera, tolerance=0.0)
    shift = np.linalg.solve(undistort_points_jacobian(some, camera), wrong[:, :, None])[:, :, 0]
    error = np.nanmax(np.linalg.norm(shift, axis=1))
    print(
        f"  points, {method}, cv2.undistortPoints ÷ ours, cold / warm: {cold:.1f} / {warm:.1f}; "
        f"largest error {error:.5f} px"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mrcal", metavar="PYTHON")
    parser.add_argument("--lensboy", metavar="PYTHON")
    parser.add_argument("lenses", nargs="*", metavar="LENS", help=", ".join(LENSES), default=DEFAULT)
    options = parser.parse_args()
    peers = {}
    for name, python, program in (("mrcal", options.mrcal, MRCAL), ("lensboy", options.lensboy, LENSBOY)):
        taken = peer_seconds(python, program) if python else None
        if taken is not None:
            peers[name] = taken
    with tempfile.TemporaryDirectory() as folder:
        for name in options.lenses:
            paths = {method: Path(folder) / f"{name}-{method}.npz" for method in METHODS}
            for method, path in paths.items():
                write_camera(path, calibrated(name, method))
            print(name, flush=True)
            camera, made = compare_maps(paths["joint"], peers)
            compare_frames(camera, made)
            for method, path in paths.items():
                compare_points(path, method)
    return 0


if __name__ == "__main__":
    sys.exit(main())
