"""Parts of one lattice, grown apart on both sides of a hand or a pole, put together again.

Two parts are one where the Gaussian process of each predicts the other: the same scale, shear and colours, a whole
number of steps away, and near enough for the prediction to be sure of that number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Floats, Ints
from pinholify.detection.growth import DISORDER, FEWEST, disorder, gate
from pinholify.detection.lattice import Lattice, turns
from pinholify.detection.prediction import predict

WIDEST_GAP = 8.0
"""Steps between two parts beyond which neither predicts the other."""

MOST_SLANT = np.deg2rad(50)
"""Between the rows, or the columns, of two parts where they are nearest."""

SURE = 0.5
"""Standard deviation, as a fraction of the spacing, above which a prediction does not tell one corner from the next."""

MEETING = 6
"""Corners of each part, the nearest to the other, that the other has to predict."""


def merged(lattices: Sequence[Lattice]) -> list[Lattice]:
    """The lattices that two or more of ``lattices`` are parts of."""
    parts, made = list(lattices), list[Lattice]()
    while (pair := _first_pair(parts)) is not None:
        first, second, whole = pair
        parts = [part for part in parts if part is not first and part is not second] + [whole]
        made = [part for part in made if part is not first and part is not second] + [whole]
    return made


def _first_pair(parts: Sequence[Lattice]) -> tuple[Lattice, Lattice, Lattice] | None:
    """Two of ``parts`` that are one lattice, and that lattice."""
    for first, second in combinations(sorted(parts, key=len, reverse=True), 2):
        whole = joined(first, second)
        if whole is not None:
            return first, second, whole
    return None


def joined(first: Lattice, second: Lattice) -> Lattice | None:
    """``first`` and ``second`` as one lattice, counted as ``first`` is, or None where they are none."""
    if min(len(first), len(second)) < FEWEST:
        return None
    for way in _ways(first, second):
        if _meet(first, way) and _meet(way, first):
            whole = first.joined(way.index, way.uv)
            if disorder(whole) <= DISORDER:
                return whole
    return None


def _ways(first: Lattice, second: Lattice) -> Iterator[Lattice]:
    """``second`` counted on from ``first``, in the ways that its place, slant and colours allow."""
    here, there = _nearest(first, second)
    frame = _frame(first, here)
    for way in turns(second, mirrored=False):
        other = _frame(way, there)
        if min(_cosine(frame[:, axis], other[:, axis]) for axis in (0, 1)) < np.cos(MOST_SLANT):
            continue
        apart = np.linalg.solve((frame + other) / 2, second.uv[there] - first.uv[here])
        if np.linalg.norm(apart) > WIDEST_GAP:
            continue
        by = first.index[here] + np.rint(apart).astype(np.int64) - way.index[there]
        for step in _keeping_colours(by, apart - np.rint(apart), same=first.phase == way.phase):
            yield way.shifted((int(step[0]), int(step[1])))


def _keeping_colours(by: Ints, rest: Floats, *, same: bool) -> Ints:
    """Shifts (n, 2) near ``by`` + ``rest`` that give both parts the same colours, the nearest first."""
    around = np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)), axis=-1).reshape(-1, 2)
    fitting = around[((by + around).sum(axis=1) % 2 == 0) == same]
    return np.asarray(by + fitting[np.argsort(((fitting - rest) ** 2).sum(axis=1))])


def _nearest(first: Lattice, second: Lattice) -> tuple[int, int]:
    """The positions of the corners of both that are nearest to each other."""
    distance, nearest = cKDTree(first.uv).query(second.uv)
    there = int(distance.argmin())
    return int(nearest[there]), there


def _frame(lattice: Lattice, corner: int) -> Floats:
    """The steps (2, 2) px to the next column and to the next row at one corner of ``lattice``, as columns."""
    return np.asarray(predict(lattice.index, lattice.uv, lattice.index[[corner]]).jacobian[0])


def _cosine(a: Floats, b: Floats) -> float:
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))


def _meet(known: Lattice, other: Lattice) -> bool:
    """Whether ``known`` predicts, and is sure of, the corners of ``other`` next to it, none of which it has itself."""
    tree = cKDTree(known.index)
    steps = tree.query(other.index)[0]
    if steps.min() == 0:
        return False
    near = np.argsort(steps, kind="stable")[:MEETING]
    expected = predict(known.index, known.uv, other.index[near])
    miss = np.linalg.norm(other.uv[near] - expected.uv, axis=1)
    sure = expected.std < SURE * expected.spacing
    return bool((sure & (miss < gate(expected))).all())
