"""Are the error bars true? Monte Carlo over the noise of whole calibrations, three lenses of the simulator.

    python benchmarks/coverage.py [LENS ...] [--draws 200]

The same boards are photographed again and again with fresh noise (0.1 px an axis), each set is calibrated with
defaults, and two promises are checked: the predicted standard deviation of a mapped point in the covered area against
the spread found, and how often the 95 % intervals of f, uc and vc hold the truth.
"""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from scipy.spatial import Delaunay

from pinholify import Corners, CornerSet, calibrate, parse_board
from pinholify.simulation.lenses import LENSES
from pinholify.simulation.views import board_poses, true_corners

BOARD = parse_board("12x9")
VIEWS = 24
NOISE = 0.1


def scene(name):
    """Exact corners (views, n, 2) and the true (f, uc, vc) of the reference board, the first view."""
    lens = LENSES[name]
    poses = board_poses([lens], BOARD, VIEWS, seed=1)
    centre = -poses[0].rotation.T @ poses[0].translation
    truth = np.array([-centre[2], centre[0], centre[1]])
    return lens, np.array([true_corners(lens, BOARD, pose) for pose in poses]), truth


def draw(arguments):
    """(f, uc, vc), their standard deviations, the virtual points of ``uv`` and their pixel standard deviations."""
    name, seed, uv = arguments
    lens, true, _ = scene(name)
    noisy = true + np.random.default_rng(seed).normal(0.0, NOISE, true.shape)
    views = tuple(Corners(f"view{i:03d}", np.arange(len(view)), view) for i, view in enumerate(noisy))
    calibration = calibrate(CornerSet(BOARD, lens.size, views), reference="view000", method="joint")
    camera = calibration.camera
    rays = camera.to_rays(uv)
    to_px = np.linalg.pinv(camera.chart.direction_jacobian(camera.plane_map.value(uv)) @ camera.plane_map.jacobian(uv))
    k = camera.intrinsics
    return [k.f, k.uc, k.vc], calibration.intrinsics_std, rays.directions, rays.std_px, to_px


def grid(lens, true):
    """Pixels inside the hull of all corners, 60 or so."""
    u, v = np.meshgrid(np.linspace(0, lens.size[0] - 1, 12), np.linspace(0, lens.size[1] - 1, 9))
    uv = np.column_stack([u.ravel(), v.ravel()])
    return uv[Delaunay(true.reshape(-1, 2)).find_simplex(uv) >= 0]


def check(name, draws):
    lens, true, truth = scene(name)
    uv = grid(lens, true)
    with ProcessPoolExecutor() as pool:
        results = list(pool.map(draw, [(name, seed, uv) for seed in range(draws)]))
    ks, stds, rays, predicted, to_px = (np.array(part) for part in zip(*results, strict=True))
    within = np.abs(ks - truth) < 1.96 * stds
    mean = rays.mean(axis=0)
    moved = np.einsum("nij,dnj->dni", to_px.mean(axis=0), rays - mean)
    sampled = np.sqrt((moved**2).mean(axis=(0, 2)) * draws / (draws - 1))
    promised = np.sqrt(np.mean(np.square(predicted), axis=0))
    ratio = sampled / promised
    print(
        f"{name:16s} {draws} draws: intervals of f, uc, vc hold the truth in "
        f"{', '.join(f'{share:.1%}' for share in within.mean(axis=0))}; spread found / promised of {len(uv)} points "
        f"{np.sqrt((sampled**2).mean() / (promised**2).mean()):.3f}, from {ratio.min():.3f} to {ratio.max():.3f}; "
        f"of f, uc, vc {np.round(ks.std(axis=0, ddof=1) / np.sqrt((stds**2).mean(axis=0)), 3)}",
        flush=True,
    )
    return within.mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("lens", nargs="*", default=["pinhole", "fisheye", "windscreen"])
    parser.add_argument("--draws", type=int, default=200)
    options = parser.parse_args()
    unknown = set(options.lens) - set(LENSES)
    if unknown:
        sys.exit(f"no lens named {', '.join(sorted(unknown))}; there are {', '.join(LENSES)}")
    print(f"pooled: {np.mean([check(name, options.draws) for name in options.lens]):.1%}")


if __name__ == "__main__":
    main()
