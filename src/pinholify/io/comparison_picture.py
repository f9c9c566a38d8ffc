"""A picture of how two cameras differ: arrows over the image, and the size of the difference by colour."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.refinement.comparison import GRID, Comparison

WIDTH = 1280


def difference_picture(comparison: Comparison, image_size: tuple[int, int]) -> NDArray[np.uint8]:
    """Arrows of the difference, magnified, over its size by colour; grey where not both cameras are believed (BGR)."""
    scale = WIDTH / image_size[0]
    height = round(image_size[1] * scale)
    length = np.linalg.norm(comparison.difference, axis=1)
    largest = float(np.nanmax(np.where(comparison.covered, length, np.nan)))
    share = np.nan_to_num(np.clip(length / max(largest, 1e-12), 0, 1)).reshape(GRID, GRID)
    heat = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    picture = cv2.resize(heat, (WIDTH, height), interpolation=cv2.INTER_LINEAR)
    covered = cv2.resize(comparison.covered.reshape(GRID, GRID).astype(np.uint8), (WIDTH, height))
    picture[covered == 0] = 150
    magnified = 0.8 * WIDTH / GRID / max(largest, 1e-12)
    for at, shift, known in zip(comparison.uv * scale, comparison.difference, comparison.covered, strict=True):
        if known:
            tip = at + magnified * shift
            cv2.arrowedLine(picture, _pixel(at), _pixel(tip), (255, 255, 255), 1, cv2.LINE_AA, tipLength=0.3)
    text = f"largest {largest:.3f} px, rms {comparison.rms():.3f} px, expected {comparison.expected_rms:.3f} px"
    bar = np.full((48, WIDTH, 3), 255, np.uint8)
    cv2.putText(bar, text, (12, 33), cv2.FONT_HERSHEY_DUPLEX, 0.9, (40, 40, 40), 1, cv2.LINE_AA)
    return np.vstack([bar, picture])


def _pixel(point: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
