"""A small camera, its pictures, and the work of straightening them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pinholify.batch.straightening import Straightening, straightening
from pinholify.io.images import write_image
from pinholify.modes import scaled
from pinholify.rectification.straightener import Straightener
from small_camera import quick_camera

SIZE = (96, 72)


@pytest.fixture(scope="session")
def straightener() -> Straightener:
    return Straightener(scaled(quick_camera(), SIZE))


@pytest.fixture(scope="session")
def work(straightener: Straightener) -> Straightening:
    return straightening(straightener)


@pytest.fixture
def pictures(tmp_path: Path) -> list[str]:
    """Twelve pictures in a folder."""
    rng = np.random.default_rng(0)
    (tmp_path / "in").mkdir()
    paths = [tmp_path / "in" / f"{i}.png" for i in range(12)]
    for path in paths:
        write_image(path, rng.integers(0, 255, SIZE[::-1], dtype=np.uint8))
    return [str(path) for path in paths]
