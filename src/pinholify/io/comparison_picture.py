"""A picture of how two cameras differ: arrows over the image, and the size of the difference by colour."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.refinement.comparison import GRID, Comparison

WIDTH = 1280
OUTSIDE = 150  # grey outside either camera's domain
INK = (40, 40, 40)
SCALE_BAR, TICKS = (230, 1010), 5  # px from left to right, numbers along it


def difference_picture(comparison: Comparison, image_size: tuple[int, int]) -> NDArray[np.uint8]:
    """A BGR picture of the difference: its size by colour, magnified arrows on top, and a legend below.

    Pixels outside either camera's domain are grey.
    """
    scale = WIDTH / image_size[0]
    height = round(image_size[1] * scale)
    length = np.linalg.norm(comparison.difference, axis=1)
    largest = max(float(np.nanmax(np.where(comparison.covered, length, np.nan))), 1e-12)
    heat = _coloured(np.nan_to_num(np.clip(length / largest, 0, 1)).reshape(GRID, GRID))
    picture = cv2.resize(heat, (WIDTH, height), interpolation=cv2.INTER_LINEAR)
    covered = cv2.resize(comparison.covered.reshape(GRID, GRID).astype(np.uint8), (WIDTH, height))
    picture[covered == 0] = OUTSIDE
    magnified = 0.8 * WIDTH / GRID / largest
    for at, shift, known in zip(comparison.uv * scale, comparison.difference, comparison.covered, strict=True):
        if known:
            tip = at + magnified * shift
            cv2.arrowedLine(picture, _pixel(at), _pixel(tip), (255, 255, 255), 1, cv2.LINE_AA, tipLength=0.3)
    title = np.full((48, WIDTH, 3), 255, np.uint8)
    text = f"largest {largest:.3f} px, RMS {comparison.rms():.3f} px, expected {comparison.expected_rms:.3f} px"
    _write(title, text, (12, 33), 0.9)
    return np.vstack([title, picture, _legend(largest, magnified / scale)])


def _legend(largest: float, magnified: float) -> NDArray[np.uint8]:
    """The colour scale from zero to the ``largest`` difference in px, and the factor by which arrows are magnified."""
    legend = np.full((80, WIDTH, 3), 255, np.uint8)
    left, right = SCALE_BAR
    legend[12:36, left:right] = _coloured(np.linspace(0.0, 1.0, right - left)[None])
    _write(legend, "difference in px", (12, 32), 0.7)
    for share in np.linspace(0.0, 1.0, TICKS):
        x = round(left + share * (right - 1 - left))
        cv2.line(legend, (x, 36), (x, 42), INK, 1)
        text = f"{share * largest:.3g}"
        (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 0.7, 1)
        _write(legend, text, (x - width // 2, 66), 0.7)
    legend[12:36, right + 50 : right + 90] = OUTSIDE
    _write(legend, "outside", (right + 102, 32), 0.7)
    _write(legend, f"arrows x {magnified:.3g}", (right + 50, 66), 0.7)
    return legend


def _coloured(share: NDArray[np.float64]) -> NDArray[np.uint8]:
    """BGR colours (h, w, 3) uint8 of ``share`` (h, w) in [0, 1]."""
    return np.asarray(cv2.applyColorMap(np.rint(255 * share).astype(np.uint8), cv2.COLORMAP_VIRIDIS), dtype=np.uint8)


def _write(picture: NDArray[np.uint8], text: str, at: tuple[int, int], size: float) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_DUPLEX, size, INK, 1, cv2.LINE_AA)


def _pixel(point: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
