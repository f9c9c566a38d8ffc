"""Boards in front of patterns that look like boards, or like parts of one, all over the picture."""

import cv2
import numpy as np
import pytest

from pinholify import detect_board, parse_board
from pinholify.detection import growth

BOARD = parse_board("7x5")
SIDE, LEFT, TOP = 22, 230, 150
"""Of the board's squares, and of its first corner, in px of a picture of 640x480 px."""

PICTURE = np.array([[0.93, 0.12, 30.0], [-0.07, 0.86, 70.0], [-8e-5, 2.5e-4, 1.0]])
"""From the plane of board and pattern to the picture: the pattern gets finer downwards, to less than two pixels."""


def slats(u, v):
    return np.sin(0.65 * u)


def checks(u, v):
    return np.sin(0.42 * u) * np.sin(0.38 * v)


def waves(u, v):
    return np.sin(u / 3.1) * np.sin(v / 4.3 + u / 23)


def in_front_of(pattern):
    """A picture of the board with a white margin of a square in front of ``pattern``, and where its corners are."""
    scale = 3
    v, u = (np.mgrid[0 : 640 * scale, 0 : 860 * scale] + 0.5) / scale
    plane = 130 + 90 * np.sign(pattern(u, v))
    column, row = (u - LEFT) / SIDE, (v - TOP) / SIDE
    paper = (column > -2) & (column < BOARD.columns + 1) & (row > -2) & (row < BOARD.rows + 1)
    squares = (column > -1) & (column < BOARD.columns) & (row > -1) & (row < BOARD.rows)
    black = squares & ((np.floor(column) + np.floor(row)) % 2 == 0)
    plane = np.where(paper, np.where(black, 20.0, 220.0), plane).astype(np.float32)
    pixels = np.array([[1 / scale, 0, 0.5 / scale - 0.5], [0, 1 / scale, 0.5 / scale - 0.5], [0, 0, 1]])
    fine = np.array([[scale, 0, scale / 2 - 0.5], [0, scale, scale / 2 - 0.5], [0, 0, 1]]) @ PICTURE @ pixels
    image = cv2.warpPerspective(plane, fine, (640 * scale, 480 * scale), borderMode=cv2.BORDER_REFLECT)
    image = cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA)
    noisy = cv2.GaussianBlur(image, (0, 0), 0.5) + np.random.default_rng(0).normal(0, 2, image.shape)
    corner = np.stack(np.meshgrid(np.arange(BOARD.columns), np.arange(BOARD.rows)), axis=-1).reshape(1, -1, 2)
    uv = cv2.perspectiveTransform(corner * float(SIDE) + [LEFT - 0.5, TOP - 0.5], PICTURE)[0]
    return np.clip(noisy, 0, 255).astype(np.uint8), uv


@pytest.fixture
def grown(monkeypatch):
    """The numbers of corners of all lattices that are grown."""
    counts = []
    grow = growth.Grower.grow

    def counted(self, lattice):
        whole = grow(self, lattice)
        counts.append(len(whole))
        return whole

    monkeypatch.setattr(growth.Grower, "grow", counted)
    return counts


@pytest.mark.parametrize("pattern", [slats, checks, waves])
def test_a_board_is_found_in_front_of_a_pattern(pattern, grown):
    image, uv = in_front_of(pattern)
    found = detect_board(image, BOARD)
    assert len(found) == 35
    assert np.linalg.norm(found.uv[:, None] - uv, axis=2).min(axis=1).max() < 0.2
    assert max(grown) < 500
    assert sum(grown) < 2500


def test_a_pattern_alone_takes_little_work_and_is_larger_than_the_board(grown):
    v, u = np.mgrid[0:480, 0:640]
    found = detect_board((130 + 90 * np.sign(checks(u, v))).astype(np.uint8), BOARD)
    assert "larger than" in found.reason
    assert max(grown) < 500
    assert sum(grown) < 5000
