"""Parts of one lattice, grown separately on both sides of a hand or a pole, joined again.

Two parts belong together if the Gaussian process of each predicts the other: the same scale, shear and colours, a whole
number of steps apart, and near enough for that number to be certain.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Floats, Ints
from pinholify.detection.growth import MAX_DISORDER, MIN_LATTICE_CORNERS, disorder, gate
from pinholify.detection.lattice import Lattice, turns
from pinholify.detection.prediction import predict

MAX_GAP = 8.0
"""Steps between two parts beyond which they are not joined."""

MAX_SLANT_RAD = np.deg2rad(50)
"""Largest angle between the rows, or the columns, of two parts where they are nearest."""

MAX_RELATIVE_STD = 0.5
"""Standard deviation, as a fraction of the spacing, above which a prediction cannot tell one corner from the next."""

MEETING_CORNERS = 6
"""Number of corners of each part, those nearest to the other part, that the other has to predict."""


def merged(lattices: Sequence[Lattice]) -> list[Lattice]:
    """The lattices joined from two or more of ``lattices``."""
    parts, made = list(lattices), list[Lattice]()
    while (pair := _first_pair(parts)) is not None:
        first, second, whole = pair
        parts = [part for part in parts if part is not first and part is not second] + [whole]
        made = [part for part in made if part is not first and part is not second] + [whole]
    return made


def _first_pair(parts: Sequence[Lattice]) -> tuple[Lattice, Lattice, Lattice] | None:
    """Two of ``parts`` that belong to one lattice, and that lattice."""
    for first, second in combinations(sorted(parts, key=len, reverse=True), 2):
        whole = joined(first, second)
        if whole is not None:
            return first, second, whole
    return None


def joined(first: Lattice, second: Lattice) -> Lattice | None:
    """``first`` and ``second`` as one lattice, numbered like ``first``; None where they do not belong together."""
    if min(len(first), len(second)) < MIN_LATTICE_CORNERS:
        return None
    for way in _ways(first, second):
        if _meet(first, way) and _meet(way, first):
            whole = first.joined(way.index, way.uv)
            if disorder(whole) <= MAX_DISORDER:
                return whole
    return None


def _ways(first: Lattice, second: Lattice) -> Iterator[Lattice]:
    """``second`` in the numberings that continue ``first``, as far as position, slant and colours allow."""
    here, there = _nearest(first, second)
    frame = _frame(first, here)
    for way in turns(second, mirrored=False):
        other = _frame(way, there)
        if min(_cosine(frame[:, axis], other[:, axis]) for axis in (0, 1)) < np.cos(MAX_SLANT_RAD):
            continue
        apart = np.linalg.solve((frame + other) / 2, second.uv[there] - first.uv[here])
        if np.linalg.norm(apart) > MAX_GAP:
            continue
        by = first.index[here] + np.rint(apart).astype(np.int64) - way.index[there]
        for step in _keeping_colours(by, apart - np.rint(apart), same=first.phase == way.phase):
            yield way.shifted((int(step[0]), int(step[1])))


def _keeping_colours(by: Ints, rest: Floats, *, same: bool) -> Ints:
    """Shifts (n, 2) near ``by`` + ``rest`` that give both parts the same colours, nearest first."""
    around = np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)), axis=-1).reshape(-1, 2)
    fitting = around[((by + around).sum(axis=1) % 2 == 0) == same]
    return np.asarray(by + fitting[np.argsort(((fitting - rest) ** 2).sum(axis=1))])


def _nearest(first: Lattice, second: Lattice) -> tuple[int, int]:
    """The positions in both lattices of the two corners nearest to each other."""
    distance, nearest = cKDTree(first.uv).query(second.uv)
    there = int(distance.argmin())
    return int(nearest[there]), there


def _frame(lattice: Lattice, corner: int) -> Floats:
    """The steps (2, 2) px to the next column and to the next row at one corner of ``lattice``, as columns."""
    return np.asarray(predict(lattice.index, lattice.uv, lattice.index[[corner]]).jacobian[0])


def _cosine(a: Floats, b: Floats) -> float:
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))


def _meet(known: Lattice, other: Lattice) -> bool:
    """Whether ``known`` reliably predicts the corners of ``other`` next to it, and has none of them itself."""
    tree = cKDTree(known.index)
    steps = tree.query(other.index)[0]
    if steps.min() == 0:
        return False
    near = np.argsort(steps, kind="stable")[:MEETING_CORNERS]
    expected = predict(known.index, known.uv, other.index[near])
    miss = np.linalg.norm(other.uv[near] - expected.uv, axis=1)
    sure = expected.std < MAX_RELATIVE_STD * expected.spacing
    return bool((sure & (miss < gate(expected))).all())
