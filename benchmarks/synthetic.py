"""Synthetic calibrations with known truth, for ``peers.py``: noisy corners of boards that simulated lenses see.

    python benchmarks/synthetic.py FOLDER [CASE ...]

writes, for each of ``CASES``, CASE.vnl (the corners), CASE.pixels.csv (pixels over the whole image, whose rays are to
be found) and CASE.npz (both, and the true rays).
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from pinholify.board import Checkerboard
from pinholify.simulation.lenses import LENSES, Fisheye, Lens, Pinhole, Unity, bumpy
from pinholify.simulation.views import board_poses, true_corners

GRID = 49, 28  # columns and rows of pixels at which rays are compared


@dataclass(frozen=True)
class Case:
    """Noise is the standard deviation of a corner per axis, px; ``board`` are inner corners, columns x rows."""

    lens: Lens
    board: tuple[int, int] = (15, 9)
    views: int = 30
    seed: int = 1
    noise: float = 0.1


CASES = {
    "pinhole": Case(Pinhole((3840, 2160), 2000.0)),
    "barrel": Case(Unity((3840, 2160), 2000.0, 55.0)),
    "pincushion": Case(Unity((3840, 2160), 2000.0, -40.0, (-0.15, 0.15))),
    "rational": Case(LENSES["rational-prism-tilt"]),
    "windshield": Case(bumpy(Fisheye((1920, 1200), 850.0), count=12, width=160.0, shift=2.0, seed=3), (14, 10), 60),
    "fisheye": Case(Fisheye((1600, 1200), 560.0, (0.02, -0.008, 0.001, 0.0), (6.0, -9.0)), views=40),
}


def make(folder, names, cases=CASES):
    for name in names or cases:
        write(folder, name, cases[name])


def write(folder, name, case):
    board = Checkerboard(*case.board)
    poses = board_poses([case.lens], board, case.views, seed=case.seed)
    true = np.array([true_corners(case.lens, board, pose) for pose in poses])
    noisy = true + np.random.default_rng(case.seed).normal(0.0, case.noise, true.shape)
    u, v = (np.linspace(0, extent - 1, count) for extent, count in zip(case.lens.size, GRID, strict=True))
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = case.lens.unproject(pixels).directions
    with np.errstate(invalid="ignore"):
        imaged = np.linalg.norm(case.lens.project(rays) - pixels, axis=1) < 1e-6
    pixels, rays = pixels[imaged], rays[imaged]
    covered = Delaunay(true.reshape(-1, 2)).find_simplex(pixels) >= 0
    np.savez(folder / f"{name}.npz", noisy=noisy, px=pixels, rays=rays, covered=covered, size=case.lens.size,
             board=case.board)
    np.savetxt(folder / f"{name}.pixels.csv", pixels, delimiter=",", fmt="%.6f", header="x,y", comments="")
    lines = [f"frame{i:03d}.png {u:.6f} {v:.6f} 0" for i, view in enumerate(noisy) for u, v in view]
    (folder / f"{name}.vnl").write_text("\n".join(["# filename x y level", *lines, ""]))


def score_file(truth, table, cases=CASES):
    """Errors of the rays in ``table``, px, inside the hull of all corners and over the whole image.

    The best rotation is removed first: no program knows the frame of the true rays.
    """
    known = np.load(truth)
    covered = known["covered"]
    rays = np.genfromtxt(table, delimiter=",", skip_header=1)[:, :3]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    turn, _ = Rotation.align_vectors(known["rays"][covered], rays[covered])
    error = np.linalg.norm(cases[truth.stem].lens.project(turn.apply(rays)) - known["px"], axis=1)
    return {"covered": error[covered], "image": error}


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
    make(Path(sys.argv[1]), sys.argv[2:])
