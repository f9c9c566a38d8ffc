"""Corner detection against OpenCV's two chessboard detectors, on the same pictures in one run.

    python benchmarks/detection.py scenes SCENES.py FOLDER [BOARD]   # accuracy on rendered scenes with known corners
    python benchmarks/detection.py time [PHOTOGRAPH BOARD]           # seconds an image at 1080p, 4K and 24 megapixels

SCENES.py is the scene renderer and scorer that stands beside the project's shared data; FOLDER holds what its ``make``
wrote. OpenCV's classic detector is followed by cornerSubPix, as users do; its sector-based one (SB) refines by itself.
Corners that OpenCV returns are complete boards or nothing.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from pinholify.board import Board, parse_board, size
from pinholify.detection import detect_board
from pinholify.io.images import read_image

Detector = Callable[[np.ndarray, Board], np.ndarray]


def ours(image: np.ndarray, board: Board) -> np.ndarray:
    table = np.full((size(board), 2), np.nan)
    corners = detect_board(image, board)
    table[corners.ids] = corners.uv
    return table


def classic(image: np.ndarray, board: Board) -> np.ndarray:
    found, corners = cv2.findChessboardCorners(image, (board.columns, board.rows))
    if not found:
        return np.full((size(board), 2), np.nan)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    return cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), stop).reshape(-1, 2)


def sector_based(image: np.ndarray, board: Board) -> np.ndarray:
    found, corners = cv2.findChessboardCornersSB(image, (board.columns, board.rows))
    return corners.reshape(-1, 2) if found else np.full((size(board), 2), np.nan)


DETECTORS: dict[str, Detector] = {"pinholify": ours, "classic": classic, "SB": sector_based}


def scenes(scorer: Path, folder: Path, board: Board) -> None:
    spec = importlib.util.spec_from_file_location("scenes", scorer)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["scenes"] = module
    spec.loader.exec_module(module)
    for name, detector in DETECTORS.items():
        with tempfile.NamedTemporaryFile("w", suffix=".vnl") as table:
            table.write("# filename x y level\n")
            start = time.perf_counter()
            for path in sorted(folder.glob("*.png")):
                for x, y in detector(read_image(path), board):
                    table.write(f"{path.name} {x} {y} 0\n" if np.isfinite(x) else f"{path.name} - - -\n")
            seconds = time.perf_counter() - start
            table.flush()
            print(f"{name}, {seconds:.0f} s in all")
            for kind, row in module.score(folder, Path(table.name)).items():
                cells = (f"{k} {v:.4f}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items())
                print(f"  {kind:16s} " + "  ".join(cells))


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


def main(arguments: list[str]) -> None:
    match arguments:
        case ["scenes", scorer, folder, *board]:
            scenes(Path(scorer), Path(folder), parse_board(board[0] if board else "15x9"))
        case ["time"]:
            board = parse_board("15x9")
            pictures = {
                "1080p": rendered(board, 1920, 1080),
                "4K": rendered(board, 3840, 2160),
                "24 megapixels": rendered(board, 6000, 4000),
                "24 MP, none": textured(6000, 4000),
            }
            timing(pictures, board)
        case ["time", photograph, board]:
            timing({photograph: cv2.cvtColor(read_image(photograph), cv2.COLOR_BGR2GRAY)}, parse_board(board))
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
