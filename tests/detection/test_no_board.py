"""Pictures of things that are no checkerboard, and of one that is too large."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from pinholify.board import Checkerboard
from pinholify.detection import detect_board, detect_size

SIZE = (480, 640)


def _warped(texture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A texture seen from a random side, shaded and with noise, 8 bit."""
    height, width = SIZE
    ends = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    source = ends * [texture.shape[1], texture.shape[0]]
    target = ends * [width, height] + rng.uniform(-120, 60, (4, 2)) * (1 - 2 * ends)
    h = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    image = cv2.warpPerspective(texture.astype(np.float32), h, (width, height), flags=cv2.INTER_AREA)
    slope = rng.uniform(-0.3, 0.3, 2)
    shade = 1 + slope[0] * np.linspace(-1, 1, width)[None] + slope[1] * np.linspace(-1, 1, height)[:, None]
    image = cv2.GaussianBlur(image * shade, (0, 0), rng.uniform(0.6, 1.5)) + rng.normal(0, 3, SIZE)
    return np.clip(image, 0, 255).astype(np.uint8)


def blank(rng: np.random.Generator) -> np.ndarray:
    return np.full(SIZE, int(rng.integers(0, 256)), np.uint8)


def noise(rng: np.random.Generator) -> np.ndarray:
    image = rng.normal(128, 40, SIZE)
    blur = rng.uniform(0, 6)
    if blur > 0.5:
        image = cv2.GaussianBlur(image, (0, 0), blur)
        image = (image - image.mean()) / image.std() * 50 + 128
    return np.clip(image, 0, 255).astype(np.uint8)


def text(rng: np.random.Generator) -> np.ndarray:
    image = np.full(SIZE, 240, np.uint8)
    letters = list("ABEFHILMNTXWZabcdefhijklmnoprstuxz0123456789+#%&=")
    scale = rng.uniform(0.4, 1.2)
    for y in range(20, SIZE[0], int(26 * scale) + 4):
        line = "".join(rng.choice(letters, 70))
        cv2.putText(image, line, (5, y), cv2.FONT_HERSHEY_SIMPLEX, scale, 20, int(rng.integers(1, 3)))
    return _warped(image, rng)


def bricks(rng: np.random.Generator) -> np.ndarray:
    image = np.full((600, 800), 190.0)
    high, wide, joint = int(rng.integers(20, 50)), int(rng.integers(50, 110)), int(rng.integers(2, 8))
    for row, y in enumerate(range(0, 600, high)):
        for x in range(-(row % 2) * wide // 2, 800, wide):
            grey = float(rng.uniform(70, 120))
            cv2.rectangle(image, (x + joint, y + joint), (x + wide - joint, y + high - joint), grey, -1)
    return _warped(image, rng)


def tiles(rng: np.random.Generator) -> np.ndarray:
    """A floor of tiles of one colour."""
    image = np.full((600, 800), float(rng.choice([60, 200])))
    side, joint = int(rng.integers(25, 80)), int(rng.integers(1, 5))
    for y in range(0, 600, side):
        for x in range(0, 800, side):
            grey = float(rng.uniform(120, 135))
            cv2.rectangle(image, (x + joint, y + joint), (x + side - joint, y + side - joint), grey, -1)
    return _warped(image, rng)


def blinds(rng: np.random.Generator) -> np.ndarray:
    image = np.zeros((600, 800)) + 60
    period, wide = int(rng.integers(12, 40)), rng.uniform(0.3, 0.8)
    image[np.arange(600) % period < wide * period] = 220
    for x in rng.integers(0, 800, 3):
        image[:, x : x + 3] = 150
    return _warped(image, rng)


NOTHING: list[Callable[[np.random.Generator], np.ndarray]] = [blank, noise, text, bricks, tiles, blinds]


def alternating_floor(rng: np.random.Generator, side: int = 40) -> np.ndarray:
    """Black and white tiles from edge to edge: about 20 x 15 inner corners."""
    y, x = np.mgrid[0:600, 0:800] // side
    return _warped(np.where((x + y) % 2 == 0, 40.0, 210.0), rng)


BOARD = Checkerboard(9, 6)


def no_board_in(kind, seeds):
    for seed in seeds:
        corners = detect_board(kind(np.random.default_rng([seed, 77])), BOARD)
        assert not corners.found, f"seed {seed}"
        assert corners.reason


@pytest.mark.parametrize("kind", NOTHING)
def test_no_board_is_seen_where_none_is(kind):
    no_board_in(kind, range(3))


@pytest.mark.slow
@pytest.mark.parametrize("kind", NOTHING)
def test_no_board_is_seen_in_two_hundred_pictures(kind):
    no_board_in(kind, range(100, 134))


@pytest.mark.parametrize("side", [30, 60])
def test_a_floor_larger_than_the_board_is_not_the_board(side):
    floor = alternating_floor(np.random.default_rng(side), side)
    assert "is larger than 9x6" in detect_board(floor, BOARD).reason
    assert detect_size(floor) is None
