"""Corner detection against other detectors, on the same pictures in one run.

    python benchmarks/detection.py scenes SCENES.py FOLDER [--board 15x9] [--libcbdetect PYTHON]
    python benchmarks/detection.py time [PHOTOGRAPH --board 15x9]      # seconds an image at 1080p, 4K, 24 megapixels

SCENES.py is the scene renderer and scorer that stands beside the project's shared data; FOLDER holds what its ``make``
wrote, or, for a ChArUco board, what ``detection_charuco.py`` wrote. OpenCV's classic detector is followed by
cornerSubPix, as users do; its sector-based one (SB) refines by itself; both return complete boards or nothing.
libcbdetect runs in a process of PYTHON, a Python that has it, and is timed in there. ``partial`` counts scenes of which
some corners were found, but not all; ``time`` is that of all scenes, ÷ ours.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np

from pinholify.board import Board, Charuco, parse_board, size
from pinholify.detection import detect_board
from pinholify.io.images import read_image

Detector = Callable[[np.ndarray, Board], np.ndarray]
"""An image to the corners (n, 2) of a board in the order of its ids, nan where one is not found."""


def ours(image: np.ndarray, board: Board) -> np.ndarray:
    table = nothing(board)
    corners = detect_board(image, board)
    table[corners.ids] = corners.uv
    return table


def classic(image: np.ndarray, board: Board) -> np.ndarray:
    found, corners = cv2.findChessboardCorners(image, (board.columns, board.rows))
    if not found:
        return nothing(board)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    return cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), stop).reshape(-1, 2)


def sector_based(image: np.ndarray, board: Board) -> np.ndarray:
    found, corners = cv2.findChessboardCornersSB(image, (board.columns, board.rows))
    return corners.reshape(-1, 2) if found else nothing(board)


def opencv_charuco(image: np.ndarray, board: Charuco) -> np.ndarray:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    pattern = cv2.aruco.CharucoBoard((board.columns + 1, board.rows + 1), 1.0, board.marker, dictionary)
    uv, ids, _, _ = cv2.aruco.CharucoDetector(pattern).detectBoard(image)
    table = nothing(board)
    if ids is not None:
        table[ids.ravel()] = uv.reshape(-1, 2)
    return table


def nothing(board: Board) -> np.ndarray:
    return np.full((size(board), 2), np.nan)


DETECTORS: dict[str, Detector] = {"pinholify": ours, "classic": classic, "SB": sector_based}
OF_CHARUCO: dict[str, Detector] = {"pinholify": ours, "OpenCV ChArUco": opencv_charuco}

Timed = Iterator[tuple[np.ndarray, float]]
"""Of each picture: the corners and the seconds they took."""


def run(detector: Detector, paths: list[Path], board: Board) -> Timed:
    for path in paths:
        image = read_image(path)
        start = time.perf_counter()
        corners = detector(image, board)
        yield corners, time.perf_counter() - start


def run_libcbdetect(python: str, paths: list[Path], board: Board) -> Timed:
    script = Path(__file__).with_name("peer_libcbdetect.py")
    with tempfile.TemporaryDirectory() as folder:
        copies = [Path(folder) / f"{path.stem}.bmp" for path in paths]
        for path, copy in zip(paths, copies, strict=True):
            cv2.imwrite(str(copy), read_image(path))
        names = "\n".join(map(str, copies))
        done = subprocess.run([python, str(script)], input=names, text=True, capture_output=True, check=True)
    for line in done.stdout.splitlines():
        answer = json.loads(line)
        yield on_board(answer["board"], board), answer["seconds"]


def on_board(rows: list[list[list[float] | None]], board: Board) -> np.ndarray:
    """Rows of corners, None where one is missing, as a table of ``board``, at its first corner.

    They are turned to fit, and where they fit both ways, so that rows run along rows of the image.
    """
    table = nothing(board).reshape(board.rows, board.columns, 2)
    if not rows:
        return table.reshape(-1, 2)
    found = np.array([[uv or (np.nan, np.nan) for uv in row] for row in rows], dtype=float)
    fits, fits_turned = (h <= board.rows and w <= board.columns for h, w in (found.shape[:2], found.shape[1::-1]))
    along, down = steps(found)
    if (fits_turned and abs(along[1]) > abs(along[0])) or not fits:
        found, along, down = found.transpose(1, 0, 2), down, along
    if along[0] * down[1] < along[1] * down[0]:  # counted left-handed
        found = found[:, ::-1]
    found = found[: board.rows, : board.columns]
    table[: found.shape[0], : found.shape[1]] = found
    return table.reshape(-1, 2)


def steps(found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean step in px along the rows and down the columns of ``found`` (rows, columns, 2)."""
    return np.nanmean(np.diff(found, axis=1), axis=(0, 1)), np.nanmean(np.diff(found, axis=0), axis=(0, 1))


def scorer_of(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("scenes", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["scenes"] = module
    spec.loader.exec_module(module)
    return module


def scenes(scorer: Path, folder: Path, board: Board, libcbdetect: str | None) -> None:
    module = scorer_of(scorer)
    paths = sorted(folder.glob("*.png"))
    detectors = OF_CHARUCO if isinstance(board, Charuco) else DETECTORS
    runs = {name: run(detector, paths, board) for name, detector in detectors.items()}
    if libcbdetect is not None and not isinstance(board, Charuco):
        runs["libcbdetect"] = run_libcbdetect(libcbdetect, paths, board)
    own = None
    for name, timed in runs.items():
        tables, seconds = zip(*timed, strict=True)
        own = own or sum(seconds)
        print(f"{name}, time x{sum(seconds) / own:.2f}")
        print_scores(module, folder, dict(zip(paths, tables, strict=True)))


def print_scores(module: ModuleType, folder: Path, tables: dict[Path, np.ndarray]) -> None:
    some = Counter(path.stem.rsplit("-", 1)[0] for path, table in tables.items() if np.isfinite(table).any())
    with tempfile.NamedTemporaryFile("w", suffix=".vnl") as file:
        file.write("# filename x y level\n")
        for path, table in tables.items():
            for x, y in table:
                file.write(f"{path.name} {x} {y} 0\n" if np.isfinite(x) else f"{path.name} - - -\n")
        file.flush()
        scores = module.score(folder, Path(file.name))
    some["all"] = some.total()
    for kind, row in scores.items():
        row = {"scenes": row["scenes"], "complete": row["complete"], "partial": some[kind] - row["complete"]} | row
        cells = (f"{k} {v:.4f}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items())
        print(f"  {kind:16s} " + "  ".join(cells), flush=True)


def rendered(board: Board, width: int, height: int) -> np.ndarray:
    """A board that fills most of the frame, seen from a side, with blur and noise."""
    side = 40
    squares = np.indices((board.rows + 1, board.columns + 1)).sum(axis=0) % 2 * 200 + 30
    texture = np.pad(np.kron(squares, np.ones((side, side))), side, constant_values=230).astype(np.float32)
    h, w = texture.shape
    ends = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    seen = np.array([[0.06, 0.08], [0.93, 0.04], [0.97, 0.95], [0.03, 0.88]]) * [width, height]
    homography = cv2.getPerspectiveTransform(ends, seen.astype(np.float32))
    image = cv2.warpPerspective(texture, homography, (width, height), borderValue=110)
    image = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(0).normal(0, 3, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def textured(width: int, height: int) -> np.ndarray:
    """No board: soft noise at full contrast, the worst case for a search."""
    image = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 1, (height, width)).astype(np.float32), (0, 0), 2)
    return cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def seconds(function: Detector, image: np.ndarray, board: Board, repeat: int) -> tuple[float, int]:
    best = np.inf
    for _ in range(repeat):
        start = time.perf_counter()
        corners = function(image, board)
        best = min(best, time.perf_counter() - start)
    return best, int(np.isfinite(corners[:, 0]).sum())


def timing(pictures: dict[str, np.ndarray], board: Board) -> None:
    for name, image in pictures.items():
        row = {k: seconds(f, image, board, 2 if image.size > 2e7 else 7) for k, f in DETECTORS.items()}
        own = row["pinholify"][0]
        cells = (f"{k} {s:.3f} s ({n} corners, x{s / own:.2f})" for k, (s, n) in row.items())
        print(f"{name:14s} " + "   ".join(cells), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["scenes", "time"])
    parser.add_argument("paths", nargs="*", type=Path)
    parser.add_argument("--board", type=parse_board, default=parse_board("15x9"))
    parser.add_argument("--libcbdetect", metavar="PYTHON")
    options = parser.parse_args()
    match options.what, options.paths:
        case "scenes", [scorer, folder]:
            scenes(scorer, folder, options.board, options.libcbdetect)
        case "time", []:
            pictures = {
                "1080p": rendered(options.board, 1920, 1080),
                "4K": rendered(options.board, 3840, 2160),
                "24 megapixels": rendered(options.board, 6000, 4000),
                "24 MP, none": textured(6000, 4000),
            }
            timing(pictures, options.board)
        case "time", [photograph]:
            timing({photograph.name: cv2.cvtColor(read_image(photograph), cv2.COLOR_BGR2GRAY)}, options.board)
        case _:
            parser.error("scenes takes SCENES.py and FOLDER, time at most a photograph")


if __name__ == "__main__":
    main()
