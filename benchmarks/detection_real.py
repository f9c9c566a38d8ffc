"""Held-out calibration error with our corners and with OpenCV's, on photographs in one run.

    python benchmarks/detection_real.py DATA [SET ...]

DATA holds the folders of ``SETS``. Only corners that both found count, so that the cameras differ by where the corners
were placed, and by nothing else: all are calibrated by our joint solve and by OpenCV's models on the same half of the
boards and scored on the other half, each with its own corners. ``looked again`` are ours after a second look with the
camera that they gave, as ``pinholify calibrate --refine-corners`` takes it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from detection import classic, opencv_charuco
from pinholify.board import Board, Charuco, parse_board
from pinholify.corners import Corners, CornerSet
from pinholify.detection import detect_files, look_again_in_files
from pinholify.detection.intensity import grey_levels
from pinholify.evaluation.baseline import MODELS
from pinholify.evaluation.heldout import Split, alternating_split, camera_residuals, heldout_rms, opencv_residuals
from pinholify.io.images import image_paths, read_image
from pinholify.pipeline import calibrate

SETS = {"gopro_wide": "8x6", "webcam_mild": "9x6", "charuco": "charuco:9x7:DICT_4X4_100:0.5"}
SAME = 3.0  # px: corners nearer than this are one
FEWEST = 20


def by_opencv(path: Path, board: Board) -> np.ndarray:
    grey = grey_levels(read_image(path)).astype(np.uint8)
    return opencv_charuco(grey, board) if isinstance(board, Charuco) else classic(grey, board)


def common(first: Corners, others: np.ndarray) -> tuple[Corners, Corners]:
    """The corners of ``first`` that stand in the table ``others`` (n, 2) too, and those there under the same ids."""
    known = others[np.isfinite(others).all(axis=1)]
    if not len(known) or not first.found:
        return first.select(np.zeros(len(first), dtype=bool)), Corners(first.name, [], np.empty((0, 2)))
    distance = np.linalg.norm(first.uv[:, None] - known, axis=2)
    kept = first.select(distance.min(axis=1) < SAME)
    return kept, Corners(first.name, kept.ids, known[distance.argmin(axis=1)[distance.min(axis=1) < SAME]])


def same_boards(corner_set: CornerSet, names: Sequence[str]) -> Split:
    """The split of ``corner_set`` with the boards called ``names`` in training."""
    split = alternating_split(corner_set, corner_set.views)
    assert {view.name for view in split.train.views} == set(names), "corners differ so much that boards change places"
    return split


def errors(corner_set: CornerSet, names: Sequence[str]) -> dict[str, float | None]:
    split = same_boards(corner_set, names)
    calibration = calibrate(split.train)
    found = {"joint": heldout_rms(camera_residuals(calibration, corner_set.board), split.test)}
    for model in MODELS:
        residuals = opencv_residuals(model, split, corner_set.board)
        found[model] = None if residuals is None else heldout_rms(residuals, split.test)
    return found


def compare(folder: Path, spec: str) -> None:
    board, paths = parse_board(spec), image_paths([folder])
    first = detect_files(paths, board)
    again = look_again_in_files(paths, first, calibrate(first).camera)
    tables = [by_opencv(path, board) for path in paths]
    both = [common(view, table) for view, table in zip(first.views, tables, strict=True)]
    chosen = [k for k, (own, _) in enumerate(both) if len(own) >= FEWEST]
    rows = {
        "ours": [both[k][0] for k in chosen],
        "ours, looked again": [again.views[k].select(np.isin(again.views[k].ids, both[k][0].ids)) for k in chosen],
        "OpenCV's": [both[k][1] for k in chosen],
    }
    counts = [sum(len(view) for view in corners.views) for corners in (first, again)]
    theirs = int(sum(np.isfinite(table[:, 0]).sum() for table in tables))
    print(
        f"{folder.name}: {len(paths)} photographs, corners found: ours {counts[0]}, looked again {counts[1]}, OpenCV's "
        f"{theirs}; common {sum(map(len, rows['ours']))} on {len(chosen)} boards"
    )
    names = [view.name for view in alternating_split(first, rows["ours"]).train.views]
    for name, views in rows.items():
        found = errors(first.with_views(views), names)
        cells = (f"{model} {'-' if error is None else f'{error:.4f}'}" for model, error in found.items())
        print(f"  {name:20s}" + "  ".join(cells), flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2 or not set(sys.argv[2:]) <= set(SETS):
        sys.exit(__doc__)
    for name in sys.argv[2:] or SETS:
        compare(Path(sys.argv[1]) / name, SETS[name])
