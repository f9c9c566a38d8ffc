"""The joint refinement, whole processes from corner table to camera, against mrcal, lensboy and OpenCV, in one run.

    python benchmarks/peers.py BENCH_FOLDER [CASE ...] [--python PYTHON]
    python benchmarks/peers.py BENCH_FOLDER --real DATA [SET ...] [--python PYTHON]

BENCH_FOLDER holds ``cases.py`` (synthetic corners with true rays), ``peer_mrcal.sh`` and ``peer_python.py``. Peers that
are not installed are left out; PYTHON is an interpreter that has lensboy, OpenCV and SciPy, where this one has not.
Errors are those of the rays, best rotation removed, in px rms inside the hull of all corners and over the whole image;
times are of whole processes, on all processors together, ours without scoring itself, the shortest of three; modules
are compiled before, as an installed program's are. The last columns are ours ÷ theirs.

With ``--real``, DATA holds folders of photographs (``REAL``). Every other complete board calibrates, the others are
scored: each peer gives rays of their corners, to which three things are fitted for every camera alike, since boards are
not flat and hands not still: a pose for each board; one shape for all of them; and for each a motion while the shutter
rolls. The root mean squares of what is left, in px a point, are held-out errors: with pose and bow alone, and with all
of these. All have the same corners, ours.
"""

import argparse
import importlib.util
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pinholify import detect_files, parse_board
from pinholify.board import lattice
from pinholify.io.images import image_paths
from pinholify.refinement.shape import board_shape

REAL = {"gopro_wide": "8x6", "webcam_mild": "9x6", "charuco": "charuco:9x7:DICT_4X4_100:0.5"}
FEWEST = 4  # boards that calibrate
WARP, MOTION, NOISE = (0.003, 0.01), 1e-5, 0.05  # what boards are thought to do: squares, radians a row, px
RUNS = 3
FOCAL = {"pinhole": 2000, "barrel": 2000, "pincushion": 2000, "windshield": 850, "fisheye": 560,
         "gopro_wide": 560, "webcam_mild": 530, "charuco": 900}
FIELD = {"pinhole": 100, "barrel": 100, "pincushion": 100, "windshield": 120, "fisheye": 170,
         "gopro_wide": 150, "webcam_mild": 90, "charuco": 90}
SPLINE = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=10_fov_x_deg={}"


def load_cases(folder):
    spec = importlib.util.spec_from_file_location("cases", folder / "cases.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["cases"] = module
    spec.loader.exec_module(module)
    return module


def ours(work, name, board, size, out):
    camera = work / f"{name}.camera.npz"
    program = [sys.executable, "-m", "pinholify"]
    options = ["--image-size", size, "--board", board, "--reference", "frame000.png", "--no-opencv", "--no-heldout"]
    calibrate = [*program, "calibrate", "--corners", str(work / f"{name}.vnl"), *options, "-o", str(camera), "--json"]
    return [calibrate, [*program, "map", str(camera), "--to", "rays", str(work / f"{name}.pixels.csv"), "-o", str(out)]]


def peers(folder, python, work, name, board, size, out):
    found = {}
    if shutil.which("mrcal-calibrate-cameras"):
        model = SPLINE.format(FIELD[name])
        script = str(folder / "peer_mrcal.sh")
        found["mrcal 16x10"] = [["bash", script, str(work), name, board, size, str(FOCAL[name]), model, str(out)]]
    models = {"OpenCV 8": "opencv8", "OpenCV fisheye": "fisheye"}
    for label, model in models.items():
        found[label] = [[sys.executable, str(folder / "peer_python.py"), str(work), name, model, str(out)]]
    if subprocess.run([python, "-c", "import lensboy"], capture_output=True).returncode == 0:
        lensboy = [python, str(folder / "peer_python.py"), str(work), name, "lensboy:16x10", str(out)]
        found["lensboy 16x10"] = [lensboy]
    return found


def run(commands):
    """Seconds of processor time, or None where a program fails or takes more than five minutes."""
    seconds = []
    try:
        for _ in range(RUNS):
            start = spent()
            for command in commands:
                subprocess.run(command, check=True, capture_output=True, timeout=300)
            seconds.append(spent() - start)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
        return None
    return min(seconds)


def spent():
    """Seconds of processor time of all programs that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def true_errors(cases, work, name, out):
    """RMS error inside the hull and over the image, px."""
    errors = cases.score_file(work / f"{name}.npz", out)
    return [float(np.sqrt(np.mean(errors[key] ** 2))) for key in ("covered", "image")]


def compare(folder, python, work, name, board, size, score):
    """Ours and every peer's ``score`` of the rays they write, and the time, as ratios."""
    out = work / f"{name}.rays.csv"
    seconds = run(ours(work, name, board, size, out))
    own = score(out)
    print(f"{name:11s} pinholify       {listed(own)} px  {seconds:6.1f} s", flush=True)
    for label, commands in peers(folder, python, work, name, board, size, out).items():
        peer_seconds = run(commands)
        if peer_seconds is None:
            print(f"{'':11s} {label:15s} failed", flush=True)
            continue
        theirs = score(out)
        ratios = listed([a / b for a, b in zip(own, theirs, strict=True)])
        print(
            f"{'':11s} {label:15s} {listed(theirs)} px  {peer_seconds:6.1f} s   ours / theirs: {ratios}, "
            f"time {seconds / peer_seconds:.2f}",
            flush=True,
        )


def listed(values):
    return " / ".join(f"{value:8.3f}" for value in values)


def complete_boards(folder, spec):
    """The whole boards in the photographs of ``folder``: their corners (boards, n, 2), and the set they are of."""
    corner_set = detect_files(image_paths([folder]), parse_board(spec))
    count = len(lattice(corner_set.board))
    whole = [view.uv[np.argsort(view.ids)] for view in corner_set.found if len(view) == count]
    return np.array(whole), corner_set


def write_set(work, name, training, testing, corner_set):
    """What ``cases.py`` writes of a synthetic case; the pixels are the corners of ``testing`` and their neighbours."""
    board = corner_set.board
    near = testing.reshape(-1, 2) + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])[:, None]
    pixels = near.reshape(-1, 2)
    np.savez(work / f"{name}.npz", noisy=training, board=(board.columns, board.rows), size=corner_set.image_size,
             px=pixels)
    np.savetxt(work / f"{name}.pixels.csv", pixels, delimiter=",", fmt="%.6f", header="x,y", comments="")
    lines = [f"frame{i:03d}.png {x:.6f} {y:.6f} 0" for i, view in enumerate(training) for x, y in view]
    (work / f"{name}.vnl").write_text("\n".join(["# filename x y level", *lines, ""]))


def heldout_errors(board, testing, out):
    """RMS in px a point of what poses and a bow, and of what a warp and motions too, leave of the boards whose corners
    are ``testing`` (boards, n, 2) px, by the rays of these in the file ``out``.
    """
    rays = np.genfromtxt(out, delimiter=",", skip_header=1)[:, :3].reshape(3, *testing.shape[:2], 3)
    ray, right, below = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    to_px = np.linalg.pinv(np.stack([r / (r * ray).sum(axis=-1, keepdims=True) - ray for r in (right, below)], axis=-1))
    late = testing[:, :, 1:] - testing[:, :, 1:].mean(axis=1, keepdims=True)
    bowed = board_shape(board)
    poses = np.array([flat_pose(bowed.flat, seen) for seen in ray])
    return [left(shape, poses, ray, to_px, late, motion) for shape, motion in
            ((bowed, 1e-9), (bowed.warped(*WARP), MOTION))]


def left(shape, poses, ray, to_px, late, motion):
    """RMS in px a point; ``late`` are rows from each board's middle, ``motion`` radians a row, a standard deviation."""
    split = [len(shape.prior_std), len(shape.prior_std) + poses.size]

    def residual(unknown):
        eta, pose, turn = np.split(unknown, split)
        pose, turn = pose.reshape(-1, 6), turn.reshape(-1, 1, 3)
        camera = shape.points(eta) @ Rotation.from_rotvec(pose[:, :3]).as_matrix().transpose(0, 2, 1)
        camera = camera + pose[:, None, 3:]
        camera = camera + late * np.cross(turn * motion, camera)
        away = camera / (camera * ray).sum(axis=-1, keepdims=True) - ray
        return np.concatenate([(to_px @ away[..., None]).ravel(), NOISE * eta / shape.prior_std, NOISE * turn.ravel()])

    start = np.concatenate([np.zeros(split[0]), poses.ravel(), np.zeros(3 * len(poses))])
    found = least_squares(residual, start, x_scale="jac").fun[: 2 * ray[..., 0].size]
    return float(np.sqrt(2.0 * np.mean(found**2)))


def flat_pose(places, ray):
    """Rotation vector and translation (6,) of a flat board seen by rays (n, 3)."""
    turn = Rotation.align_vectors([[0.0, 0.0, 1.0]], [ray.mean(axis=0)])[0].as_matrix()
    seen = ray @ turn.T
    points = np.column_stack([places, np.zeros(len(places))])
    _, vector, shift = cv2.solvePnP(points, seen[:, :2] / seen[:, 2:], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    return np.append(Rotation.from_matrix(turn.T @ cv2.Rodrigues(vector)[0]).as_rotvec(), turn.T @ shift[:, 0])


def synthetic(folder, python, work, names):
    cases = load_cases(folder)
    cases.make(work, names or list(cases.CASES))
    for name in names or cases.CASES:
        case = cases.CASES[name]
        board, size = (f"{a}x{b}" for a, b in (case.board, case.lens.size))
        compare(folder, python, work, name, board, size, lambda out, name=name: true_errors(cases, work, name, out))


def real(folder, python, work, data, names):
    for name in names or REAL:
        boards, corner_set = complete_boards(data / name, REAL[name])
        training, testing = boards[::2], boards[1::2]
        print(f"{name}: {len(training)} complete boards calibrate, {len(testing)} are scored", flush=True)
        if len(training) < FEWEST:
            print(f"{'':11s} too few: {FEWEST} are needed")
            continue
        write_set(work, name, training, testing, corner_set)
        board, (width, height) = corner_set.board, corner_set.image_size
        compare(folder, python, work, name, f"{board.columns}x{board.rows}", f"{width}x{height}",
                lambda out, board=board, testing=testing: heldout_errors(board, testing, out))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("case", nargs="*")
    parser.add_argument("--real", type=Path, metavar="DATA")
    parser.add_argument("--python", default=sys.executable)
    options = parser.parse_intermixed_args()
    folder = options.folder.resolve()
    if not (folder / "cases.py").exists():
        parser.error(f"{folder} holds no cases.py")
    with tempfile.TemporaryDirectory() as work:
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ["PYTHONPYCACHEPREFIX"] = f"{work}/modules"
        if options.real:
            real(folder, options.python, Path(work), options.real, options.case)
        else:
            synthetic(folder, options.python, Path(work), options.case)


if __name__ == "__main__":
    main()
