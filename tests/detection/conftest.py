"""Rendered boards with known corners."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from pinholify.board import Checkerboard, lattice
from pinholify.geometry import apply_homography

HOMOGRAPHY = np.array([[40.0, 6.0, 90.0], [-4.0, 38.0, 85.0], [0.004, 0.003, 1.0]])
"""Board squares to px of a 640x480 image."""


def render_board(columns, rows, *, homography=HOMOGRAPHY, size=(640, 480), noise=2.0, black_first=1):
    """An 8-bit image of a board and its corners (columns·rows, 2) in px.

    The square beyond corner 0 is black unless ``black_first`` is 0.
    """
    width, height = size
    supersampling = 4
    step = np.arange(supersampling) / supersampling + 0.5 / supersampling - 0.5
    u = (np.arange(width)[:, None] + step).ravel()
    v = (np.arange(height)[:, None] + step).ravel()
    inverse = np.linalg.inv(homography)
    w = inverse[2, 0] * u[None] + inverse[2, 1] * v[:, None] + inverse[2, 2]
    x = (inverse[0, 0] * u[None] + inverse[0, 1] * v[:, None] + inverse[0, 2]) / w
    y = (inverse[1, 0] * u[None] + inverse[1, 1] * v[:, None] + inverse[1, 2]) / w
    inside = (x > -1) & (x < columns) & (y > -1) & (y < rows)
    black = ((np.floor(x) + np.floor(y)) % 2 == 0) == black_first
    margin = (x > -1.5) & (x < columns + 0.5) & (y > -1.5) & (y < rows + 0.5)
    grey = np.where(inside & black, 25.0, np.where(margin, 225.0, 120.0))
    grey = grey.reshape(height, supersampling, width, supersampling).mean(axis=(1, 3))
    grey = cv2.GaussianBlur(grey, (0, 0), 0.8)
    grey += np.random.default_rng(0).normal(0, noise, grey.shape)
    corners = apply_homography(homography, lattice(Checkerboard(columns, rows)))
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8), corners


@pytest.fixture(scope="session")
def board_image() -> Callable:
    return render_board
