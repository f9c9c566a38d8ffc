"""Selection of frames of a video for calibration: sharp ones, each different from the last."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.io.images import Image
from pinholify.io.video.source import Frame, frames, probe

CHOSEN = 40
"""Approximate maximum number of frames to choose from a video."""

SHORTEST = 0.25
"""Shortest part of a video that yields a frame, in s; a hand does not come to rest in less."""

WIDTH = 640
"""Width in px to which frames are reduced to measure sharpness; motion blur that matters exceeds one such pixel."""

SMALL = (32, 18)
DIFFERENT = 0.05
"""RMS difference from the last frame, both reduced to SMALL px, as a fraction of the frame's own contrast."""


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """A frame of a video: its ``number`` from 0, and a grey ``image`` (height, width) uint8."""

    number: int
    image: Image


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    number: int
    frame: Frame
    sharpness: float
    small: NDArray[np.float32]


def choose_stills(path: str, *, count: int = CHOSEN, on_frame: Callable[[], object] | None = None) -> Iterator[Still]:
    """Yield the sharpest frame of each of ``count`` equal parts of the video ``path``, unless it looks like the last.

    Parts last at least SHORTEST s, and one second if the file does not contain its number of frames. ``on_frame`` is
    called for every frame. Raises ImageError if the file is not a video.
    """
    info = probe(path)
    rate = info.rate or 25
    length = max((info.frames or round(rate * count)) // count, round(rate * SHORTEST), 1)
    best: _Candidate | None = None
    last: _Candidate | None = None
    for number, frame in enumerate(frames(path)):
        if on_frame is not None:
            on_frame()
        if best is not None and number % length == 0:
            if _differ(best, last):
                yield _still(best)
                last = best
            best = None
        candidate = _candidate(number, frame)
        best = candidate if best is None or candidate.sharpness > best.sharpness else best
    if best is not None and _differ(best, last):
        yield _still(best)


def _candidate(number: int, frame: Frame) -> _Candidate:
    width = min(WIDTH, frame.width)
    height = max(round(frame.height * width / frame.width), 1)
    grey = frame.reformat(width=width, height=height, format="gray").to_ndarray()
    # The variance of the Laplacian: Pech-Pacheco et al., Diatom autofocusing in brightfield microscopy, 2000.
    sharpness = float(cv2.Laplacian(grey, cv2.CV_32F).var())
    small = cv2.resize(grey, SMALL, interpolation=cv2.INTER_AREA)
    return _Candidate(number, frame, sharpness, small.astype(np.float32))


def _differ(candidate: _Candidate, last: _Candidate | None) -> bool:
    if last is None:
        return True
    difference = np.sqrt(((candidate.small - last.small) ** 2).mean())
    return bool(difference > DIFFERENT * candidate.small.std())


def _still(candidate: _Candidate) -> Still:
    return Still(candidate.number, candidate.frame.reformat(format="gray").to_ndarray())
