"""The joint refinement, whole processes from corner table to camera, against mrcal, lensboy and OpenCV, in one run.

    python benchmarks/peers.py [CASE ...] [--cases CASES.py] [--seeds N] [--mrcal PYTHON] [--lensboy PYTHON]
    python benchmarks/peers.py --real DATA [SET ...] [--mrcal PYTHON] [--lensboy PYTHON]

Cases are those of ``synthetic.py`` beside this file, or of a file with the same functions. PYTHON are interpreters
that have mrcal (by default Debian's), and lensboy with OpenCV; peers that are not installed are left out. Errors are
those of the rays, best rotation removed, in px rms inside the hull of all corners and over the whole image. Times are
of whole processes, on all processors together, ours without scoring itself, the shortest of three; modules are compiled
before, as an installed program's are. The last columns are ours ÷ theirs. With ``--seeds`` each case is drawn anew N
times, and medians, smallest and largest errors are printed.

With ``--real``, DATA holds folders of photographs (``REAL``; CONTRIBUTING.md says where they come from). Every other
complete board calibrates, the others are scored: each peer gives rays of their corners, to which three things are
fitted for every camera alike, since boards are not flat and hands not still: a pose for each board; one shape for all
of them; and for each a motion while the shutter rolls. The root mean squares of what is left, in px a point, are
held-out errors: with pose and bow alone, and with all of these. All have the same corners, ours.
"""

import argparse
import dataclasses
import functools
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

HERE = Path(__file__).parent
REAL = {"gopro_wide": "8x6", "webcam_mild": "9x6", "charuco": "charuco:9x7:DICT_4X4_100:0.5"}
FEWEST = 4  # boards that calibrate
WARP, MOTION, NOISE = (0.003, 0.01), 1e-5, 0.05  # what boards are thought to do: squares, radians a row, px
RUNS = 3
FOCAL = {"pinhole": 2000, "barrel": 2000, "pincushion": 2000, "rational": 700, "windshield": 850, "fisheye": 560,
         "gopro_wide": 560, "webcam_mild": 530, "charuco": 900}
FIELD = {"pinhole": 100, "barrel": 100, "pincushion": 100, "rational": 100, "windshield": 120, "fisheye": 170,
         "gopro_wide": 150, "webcam_mild": 90, "charuco": 90}
SPLINE = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=10_fov_x_deg={}"


def load_cases(file):
    spec = importlib.util.spec_from_file_location("cases", file)
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


def peers(pythons, work, name, board, size, out):
    """Commands of the peers that are installed, by their label."""
    found = {}
    if has(pythons.mrcal, "mrcal"):
        model = SPLINE.format(FIELD[name])
        found["mrcal 16x10"] = [pythons.mrcal, HERE / "peer_mrcal.py", work, name, board, size, FOCAL[name], model, out]
    for label, model in {"OpenCV 8": "opencv8", "OpenCV fisheye": "fisheye"}.items():
        found[label] = [sys.executable, HERE / "peer_models.py", work, name, model, out]
    if has(pythons.lensboy, "lensboy"):
        found["lensboy 16x10"] = [pythons.lensboy, HERE / "peer_models.py", work, name, "lensboy:16x10", out]
    return {label: [list(map(str, command))] for label, command in found.items()}


def has(python, module):
    """Whether the interpreter ``python`` exists and has ``module``."""
    if shutil.which(python) is None:
        return False
    return subprocess.run([python, "-c", f"import {module}"], capture_output=True).returncode == 0


def run(commands, runs):
    """Seconds of processor time, or None where a program fails or takes more than five minutes."""
    seconds = []
    try:
        for _ in range(runs):
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


def measured(pythons, work, name, board, size, score, runs=RUNS):
    """Errors and seconds by program, ours first; None for a program that failed."""
    out = work / f"{name}.rays.csv"
    found = {}
    for label, commands in {"pinholify": ours(work, name, board, size, out),
                            **peers(pythons, work, name, board, size, out)}.items():
        seconds = run(commands, runs)
        found[label] = None if seconds is None else (score(out), seconds)
    return found


def report(name, found):
    """Print ours and every peer's errors and times, and the ratios."""
    own, seconds = found.pop("pinholify")
    print(f"{name:11s} pinholify       {listed(own)} px  {seconds:6.1f} s", flush=True)
    for label, peer in found.items():
        if peer is None:
            print(f"{'':11s} {label:15s} failed", flush=True)
            continue
        theirs, peer_seconds = peer
        ratios = listed([a / b for a, b in zip(own, theirs, strict=True)])
        print(
            f"{'':11s} {label:15s} {listed(theirs)} px  {peer_seconds:6.1f} s   ours / theirs: {ratios}, "
            f"time {seconds / peer_seconds:.2f}",
            flush=True,
        )


def report_spread(name, draws):
    """Print the medians of every program's errors over all ``draws``, the smallest and the largest."""
    for label in draws[0]:
        errors = np.array([found[label][0] for found in draws if found[label] is not None])
        failed = f", {len(draws) - len(errors)} failed" * (len(errors) < len(draws))
        spread = " / ".join(f"{np.median(e):.3f} ({e.min():.3f} to {e.max():.3f})" for e in errors.T)
        print(f"{name if label == 'pinholify' else '':11s} {label:15s} {spread} px{failed}", flush=True)


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


def synthetic(options, work):
    cases = load_cases(options.cases)
    for name in options.case or cases.CASES:
        draws = []
        for seed in range(1, options.seeds + 1):
            drawn = {name: dataclasses.replace(cases.CASES[name], seed=seed)} if options.seeds > 1 else cases.CASES
            cases.make(work, [name], drawn)
            board, size = (f"{a}x{b}" for a, b in (drawn[name].board, drawn[name].lens.size))
            score = functools.partial(true_errors, cases, work, name)
            draws.append(measured(options, work, name, board, size, score, RUNS if options.seeds == 1 else 1))
        if options.seeds == 1:
            report(name, draws[0])
        else:
            report_spread(name, draws)


def real(options, work):
    for name in options.case or REAL:
        boards, corner_set = complete_boards(options.real / name, REAL[name])
        training, testing = boards[::2], boards[1::2]
        print(f"{name}: {len(training)} complete boards calibrate, {len(testing)} are scored", flush=True)
        if len(training) < FEWEST:
            print(f"{'':11s} too few: {FEWEST} are needed")
            continue
        write_set(work, name, training, testing, corner_set)
        board, (width, height) = corner_set.board, corner_set.image_size
        score = functools.partial(heldout_errors, board, testing)
        report(name, measured(options, work, name, f"{board.columns}x{board.rows}", f"{width}x{height}", score))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", nargs="*")
    parser.add_argument("--cases", type=Path, default=HERE / "synthetic.py", metavar="CASES.py")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--real", type=Path, metavar="DATA")
    parser.add_argument("--mrcal", default="/usr/bin/python3", metavar="PYTHON")
    parser.add_argument("--lensboy", default=sys.executable, metavar="PYTHON")
    options = parser.parse_intermixed_args()
    with tempfile.TemporaryDirectory() as work:
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ["PYTHONPYCACHEPREFIX"] = f"{work}/modules"
        (real if options.real else synthetic)(options, Path(work))


if __name__ == "__main__":
    main()
