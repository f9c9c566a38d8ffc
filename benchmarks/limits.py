"""How much of what the photographs hold does the joint refinement use? Its error beside the Cramér–Rao bound.

    python benchmarks/limits.py CASES_FOLDER [CASE ...] [--seeds 20]

CASES_FOLDER holds cases.py, the synthetic cases with truth. For each seed the boards are simulated anew. The bound is
what the best unbiased estimator could reach that KNOWS the lens's formula and has to find only its numbers (six for a
Unity lens or a fisheye, three for the windscreen, whose bumps are given); ours knows nothing of the lens. Printed are
the root mean square and the median over the seeds of the covered area's error in px, as cases.py scores it, and how
often the median of that best estimator would be as low as BARS.
"""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import argparse
import dataclasses
import importlib.util
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify import Corners, CornerSet, calibrate, parse_board

DRAWS = 2000
BARS = {"pinhole": 0.042, "barrel": 0.014, "pincushion": 0.053, "windshield": 0.027, "fisheye": 0.072}


def shifted(cases, name):
    """The case's lens as a function of (rays, parameters), zero at the truth, and the steps of its parameters."""
    make = {
        "pinhole": lambda p: cases.unity(0, focal=2000 + p[0]),
        "barrel": lambda p: cases.unity(55 + p[3], (p[4], p[5]), focal=2000 + p[0]),
        "pincushion": lambda p: cases.unity(-40 + p[3], (-0.15 + p[4], 0.15 + p[5]), focal=2000 + p[0]),
        "windshield": lambda p: cases.windshield(focal=850 + p[0]),
        "fisheye": lambda p: cases.fisheye(focal=560 + p[0], k=(0.02 + p[3], -0.008 + p[4], 0.001 + p[5])),
    }[name]
    count = 3 if name in ("pinhole", "windshield") else 6
    steps = np.array([1e-2, 1e-3, 1e-3, 1e-3, 1e-6, 1e-6])
    if name == "fisheye":
        steps[3:] = 1e-6
    return (lambda rays, p: make(p).project(rays) + p[1:3]), steps[:count]


def derivative(function, steps):
    """Columns of the derivative of function(parameters) at zero, by central differences."""
    columns = []
    for index, step in enumerate(steps):
        parameters = np.zeros(6)
        parameters[index] = step
        columns.append((function(parameters) - function(-parameters)).ravel() / (2 * step))
    return np.stack(columns, 1)


def moved(points, motion):
    return Rotation.from_rotvec(motion[:3]).apply(points) + motion[3:]


def simulate(cases, case):
    """Noisy corners, their truth, and the corners' positions in the camera's frame."""
    calls = []

    def recorded(points):
        pixels = case.lens.project(points)
        calls.append((points, pixels))
        return pixels

    noisy, true, _ = cases.views(dataclasses.replace(case, lens=dataclasses.replace(case.lens, project=recorded)))
    points = [next(p for p, q in calls if q.shape == view.shape and np.array_equal(q, view)) for view in true]
    return noisy, true, points


def bound(cases, case, name, points, truth):
    """Draws of the covered area's error (DRAWS,) of the best estimator that knows the lens's formula."""
    lens, steps = shifted(cases, name)
    information = np.zeros((len(steps), len(steps)))
    for board in points:
        of_lens = derivative(lambda p, board=board: lens(board, p), steps)
        of_pose = derivative(lambda p, board=board: case.lens.project(moved(board, p)), np.full(6, 1e-6))
        basis, _ = np.linalg.qr(of_pose)
        free = of_lens - basis @ (basis.T @ of_lens)
        information += free.T @ free
    rays = truth["rays"][truth["covered"]]
    of_lens = derivative(lambda p: lens(rays, p), steps)
    of_turn = derivative(lambda p: case.lens.project(Rotation.from_rotvec(p[:3]).apply(rays)), np.full(3, 1e-6))
    response = of_lens - of_turn @ np.linalg.lstsq(of_turn, of_lens, rcond=None)[0]
    spread = np.linalg.cholesky(np.linalg.inv(information) * case.sigma**2)
    errors = np.random.default_rng(case.seed).normal(size=(DRAWS, len(steps))) @ (response @ spread).T
    return np.sqrt(2 * np.mean(errors**2, axis=1))


def ours(cases, case, noisy, truth):
    board = parse_board(f"{case.board[0]}x{case.board[1]}")
    ids = np.arange(noisy.shape[1])
    corners = tuple(Corners(f"frame{i:03d}.png", ids, view) for i, view in enumerate(noisy))
    camera = calibrate(CornerSet(board, case.lens.size, corners), reference="frame000.png").camera
    rays = camera.to_rays(truth["px"]).directions
    error = cases.score(truth["px"], rays, truth["rays"], truth["covered"], case.lens.project)["covered"]
    return np.sqrt(np.mean(error**2))


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("case", nargs="*", default=list(BARS))
    parser.add_argument("--seeds", type=int, default=20)
    options = parser.parse_args()
    spec = importlib.util.spec_from_file_location("cases", options.folder / "cases.py")
    cases = sys.modules["cases"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(cases)
    for name in options.case:
        best, own = [], []
        for seed in range(1, options.seeds + 1):
            case = dataclasses.replace(cases.CASES[name], seed=seed)
            noisy, true, points = simulate(cases, case)
            truth = cases.truth(case, true)
            best.append(bound(cases, case, name, points, truth))
            own.append(ours(cases, case, noisy, truth))
        medians = np.median(best, axis=0)
        print(
            f"{name:11s} rms ours {rms(own):.4f}, bound {rms(best):.4f}; median ours {np.median(own):.4f}, "
            f"bound {np.median(medians):.4f}, at most {BARS[name]} in {np.mean(medians <= BARS[name]):.0%} of all luck",
            flush=True,
        )


if __name__ == "__main__":
    main()
