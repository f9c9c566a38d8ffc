"""The joint refinement, whole processes from corner table to camera, against mrcal, lensboy and OpenCV, in one run.

    python benchmarks/peers.py BENCH_FOLDER [CASE ...]

BENCH_FOLDER holds ``cases.py`` (synthetic corners with true rays), ``peer_mrcal.sh`` and ``peer_python.py``. Peers that
are not installed are left out and named. Errors are those of the rays, best rotation removed, in px rms inside the hull
of all corners and over the whole image; times are of whole processes on the wall, ours without scoring itself. The last
columns are ours ÷ theirs.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np

FOCAL = {"pinhole": 2000, "barrel": 2000, "pincushion": 2000, "windshield": 850, "fisheye": 560}
FIELD = {"pinhole": 100, "barrel": 100, "pincushion": 100, "windshield": 120, "fisheye": 170}
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


def peers(folder, work, name, board, size, out):
    found = {}
    if shutil.which("mrcal-calibrate-cameras"):
        model = SPLINE.format(FIELD[name])
        script = str(folder / "peer_mrcal.sh")
        found["mrcal 16x10"] = [["bash", script, str(work), name, board, size, str(FOCAL[name]), model, str(out)]]
    models = {"OpenCV 8": "opencv8", "OpenCV fisheye": "fisheye"}
    if importlib.util.find_spec("lensboy"):
        models["lensboy 16x10"] = "lensboy:16x10"
    for label, model in models.items():
        found[label] = [[sys.executable, str(folder / "peer_python.py"), str(work), name, model, str(out)]]
    return found


def run(commands):
    """Seconds, or None where a program fails or takes more than five minutes."""
    start = time.perf_counter()
    try:
        for command in commands:
            subprocess.run(command, check=True, capture_output=True, timeout=300)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
        return None
    return time.perf_counter() - start


def score(cases, work, name, out):
    errors = cases.score_file(work / f"{name}.npz", out)
    return [float(np.sqrt(np.mean(errors[key] ** 2))) for key in ("covered", "image")]


def compare(folder, cases, work, name):
    case = cases.CASES[name]
    board, size = (f"{a}x{b}" for a, b in (case.board, case.lens.size))
    out = work / f"{name}.rays.csv"
    seconds = run(ours(work, name, board, size, out))
    covered, image = score(cases, work, name, out)
    print(f"{name:11s} pinholify       {covered:8.3f} / {image:8.3f} px  {seconds:6.1f} s", flush=True)
    for label, commands in peers(folder, work, name, board, size, out).items():
        peer_seconds = run(commands)
        if peer_seconds is None:
            print(f"{'':11s} {label:15s} failed", flush=True)
            continue
        theirs = score(cases, work, name, out)
        ratios = [covered / theirs[0], image / theirs[1], seconds / peer_seconds]
        print(
            f"{'':11s} {label:15s} {theirs[0]:8.3f} / {theirs[1]:8.3f} px  {peer_seconds:6.1f} s   ours / theirs: "
            f"{ratios[0]:.3f} / {ratios[1]:.3f}, time {ratios[2]:.2f}",
            flush=True,
        )


def main():
    if len(sys.argv) < 2 or not (Path(sys.argv[1]) / "cases.py").exists():
        sys.exit(__doc__)
    folder = Path(sys.argv[1]).resolve()
    cases = load_cases(folder)
    names = sys.argv[2:] or list(cases.CASES)
    with tempfile.TemporaryDirectory() as work:
        cases.make(Path(work), names)
        for name in names:
            compare(folder, cases, Path(work), name)


if __name__ == "__main__":
    main()
