"""Square markers as OpenCV reads them: ArUco's and AprilTag's, of one dictionary or several at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Bools, Floats, Ints

CELL = 8
"""Pixels per cell at which a marker is resampled to be read: with OpenCV's four, bent edges spoil too many of them."""


@dataclass(frozen=True, slots=True, eq=False)
class Markers:
    """Markers of one ``dictionary``: ``number`` (n,) and ``quads`` (n, 4, 2) px, clockwise from their top left."""

    dictionary: str
    number: Ints
    quads: Floats

    def __len__(self) -> int:
        """Number of markers."""
        return len(self.number)

    def select(self, keep: Bools | Ints) -> Markers:
        """The markers at ``keep``."""
        return replace(self, number=self.number[keep], quads=self.quads[keep])


def read_markers(picture: NDArray[np.uint8], dictionaries: Sequence[str], *, border: int = 1) -> tuple[Markers, ...]:
    """The markers of each of ``dictionaries`` (names in ``board.MARKERS``); of each number the largest.

    ``border`` is the number of black cells around their codes.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border
    parameters.perspectiveRemovePixelPerCell = CELL
    known = [cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)) for name in dictionaries]
    found, numbers, _, which = cv2.aruco.ArucoDetector(known, parameters).detectMarkersMultiDict(picture)
    quads = np.array(found, dtype=np.float64).reshape(-1, 4, 2)
    number, dictionary = (np.ravel([] if a is None else a).astype(np.int64) for a in (numbers, which))
    return tuple(
        _largest_of_each(Markers(name, number[dictionary == k], quads[dictionary == k]))
        for k, name in enumerate(dictionaries)
    )


def _largest_of_each(markers: Markers) -> Markers:
    """The largest of the ``markers`` of each number."""
    x, y = np.moveaxis(markers.quads, 2, 0)
    area = np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))
    order = np.argsort(-area, kind="stable")
    return markers.select(order[np.unique(markers.number[order], return_index=True)[1]])
