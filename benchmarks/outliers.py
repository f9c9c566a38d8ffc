"""What gross errors cost: the joint camera's error from spoilt corners ÷ that from the clean ones.

    python benchmarks/outliers.py CASES_FOLDER [CASE ...] [--seeds 8] [--spoilings 2]

CASES_FOLDER holds cases.py, the synthetic cases with truth. Of each simulated set one corner in twenty is moved by 5 to
50 px and two boards are counted with one axis reversed. Printed are, over all draws, the median of the ratio, the ratio
of the root mean squares, and the same for corners from which the moved ones were taken out by hand: what their absence
costs, and luck, is in both. "kept" are moved corners that were not found, "lost" honest ones that were dropped.
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

from pinholify import Corners, CornerSet, parse_board
from pinholify.calibration.numbering import numbered_alike
from pinholify.refinement import refine

NAMES = ("pinhole", "barrel", "pincushion", "windshield", "fisheye")
SHARE, SHORTEST, LONGEST = 0.05, 5.0, 50.0


def spoil(case, noisy, seed):
    """Which corners (views, corners) were moved, and the views of spoilt corners and of the honest ones alone."""
    rng = np.random.default_rng(1000 + seed)
    hit = rng.random(noisy.shape[:2]) < SHARE
    angle, length = rng.uniform(0, 2 * np.pi, hit.shape), rng.uniform(SHORTEST, LONGEST, hit.shape) * hit
    moved = noisy + np.stack([np.cos(angle), np.sin(angle)], -1) * length[..., None]
    columns, rows = rng.choice(np.arange(1, len(noisy)), 2, replace=False)
    ids = np.arange(noisy.shape[1]).reshape(case.board[::-1])
    numbers = {columns: ids[:, ::-1].ravel(), rows: ids[::-1].ravel()}
    wrong = [Corners(f"frame{i:03d}.png", numbers.get(i, ids.ravel()), uv) for i, uv in enumerate(moved)]
    return hit, wrong, [view.select(~h) for view, h in zip(clean(noisy), hit, strict=True)]


def clean(noisy):
    return [Corners(f"frame{i:03d}.png", np.arange(len(uv)), uv) for i, uv in enumerate(noisy)]


def solved(cases, case, views, truth):
    """The covered area's error, px rms, and the result."""
    corners = CornerSet(parse_board(f"{case.board[0]}x{case.board[1]}"), case.lens.size, tuple(views))
    result = refine(numbered_alike(corners, False).corner_set, reference="frame000.png")
    rays = result.camera.to_rays(truth["px"]).directions
    error = cases.score(truth["px"], rays, truth["rays"], truth["covered"], case.lens.project)["covered"]
    return np.sqrt(np.mean(error**2)), result


def compared(cases, case, spoilings):
    """Rows of errors (clean, spoilt, honest alone), and how many corners were kept and lost wrongly."""
    noisy, true, _ = cases.views(case)
    truth = cases.truth(case, true)
    before, _ = solved(cases, case, clean(noisy), truth)
    rows, kept, lost = [], 0, 0
    for seed in range(spoilings):
        hit, wrong, honest = spoil(case, noisy, seed)
        found, result = solved(cases, case, wrong, truth)
        rows.append((before, found, solved(cases, case, honest, truth)[0]))
        for view, moved in zip(wrong, hit, strict=True):
            inlier = result.inliers.get(view.name, np.zeros(len(view), dtype=bool))
            kept, lost = kept + (inlier & moved).sum(), lost + (~inlier & ~moved).sum()
    return rows, kept, lost


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("case", nargs="*", default=list(NAMES))
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--spoilings", type=int, default=2)
    options = parser.parse_args()
    spec = importlib.util.spec_from_file_location("cases", options.folder / "cases.py")
    cases = sys.modules["cases"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(cases)
    for name in options.case:
        draws = [
            compared(cases, dataclasses.replace(cases.CASES[name], seed=seed), options.spoilings)
            for seed in range(1, options.seeds + 1)
        ]
        before, found, honest = np.array([row for rows, _, _ in draws for row in rows]).T
        said = [
            f"{what}: median ratio {np.median(error / before):.3f}, rms ratio "
            f"{np.sqrt(np.mean(error**2) / np.mean(before**2)):.3f}"
            for what, error in (("spoilt", found), ("honest alone", honest))
        ]
        kept, lost = (sum(draw[index] for draw in draws) for index in (1, 2))
        worst = np.abs(found - honest).max()
        print(f"{name:11s} {'; '.join(said)}; apart by {worst:.4f} px at most; kept {kept}, lost {lost}", flush=True)


if __name__ == "__main__":
    main()
