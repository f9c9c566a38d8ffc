"""Lattices grown from a seed, ring by ring, each next corner where the Gaussian process expects it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Bools, Floats, Ints
from pinholify.detection.candidates import Candidates, neighbours
from pinholify.detection.intensity import Grey
from pinholify.detection.lattice import Lattice
from pinholify.detection.prediction import Prediction, local_frames, predict
from pinholify.detection.saddle import refine_saddles, saddle_strength, sample

FEWEST = 9
"""Corners below which a lattice is no evidence of a board."""

MOST_SEEDS = 40
"""Seeds tried in one image."""

DISORDER = 0.1
"""Above this a lattice is letters or leaves; the most bent photographs of boards stay below a third of it."""

MOST_REPAIRS = 5
"""Times that a lattice may lose corners which break it, and grow again."""

SIDES = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])

GATE = (0.1, 0.4)
"""The gate around a prediction is six standard deviations, within these fractions of the spacing."""

BESIDE = 0.125
"""How far beside an edge its colours are compared, as a fraction of the squares' width."""

WINDOW = 0.25
"""Half window of the search at a predicted place, as a fraction of the spacing."""


@dataclass(frozen=True, slots=True, eq=False)
class Grower:
    """Grows lattices over one image: its ``grey`` levels and its ``candidates``.

    ``beside`` is how far to each side of an edge its colours are compared, as a fraction of the squares' width there.
    """

    grey: Grey
    candidates: Candidates
    tree: cKDTree
    beside: float

    def lattices(self) -> Iterator[Lattice]:
        """Lattices of at least FEWEST corners, from the most regular seed on; no candidate is used twice."""
        links = neighbours(self.candidates)
        free = np.ones(len(self.candidates), dtype=bool)
        tried = 0
        for seed in _seeds(self.candidates, links):
            if not free[seed] or tried == MOST_SEEDS:
                continue
            tried += 1
            cross = _first_cross(self.candidates, links, seed)
            if not bounded(self.grey, cross, self.beside).all():
                continue
            lattice = self.grow(cross)
            if len(lattice) < FEWEST or disorder(lattice) > DISORDER:
                free[seed] = False
                continue
            near = self.tree.query_ball_point(lattice.uv, 3.0)
            free[[i for group in near for i in group]] = False
            yield lattice

    def grow(self, lattice: Lattice) -> Lattice:
        """``lattice`` with every corner that can be reached from it, without those that break it."""
        banned: set[tuple[int, int]] = set()
        for _ in range(MOST_REPAIRS):
            lattice = self._grow(lattice, banned)
            if len(lattice) < FEWEST or disorder(lattice) > DISORDER:
                break
            kept = regular(lattice)
            if kept.all():
                break
            banned |= _pairs(lattice.index[~kept])
            lattice = lattice.select(kept)
        return lattice

    def _grow(self, lattice: Lattice, banned: set[tuple[int, int]]) -> Lattice:
        """``lattice`` with ring after ring of corners that stand at the ends of good edges, none in
        ``banned``.
        """
        doubled = 2 * FEWEST
        while True:
            grown = self._ring(lattice, banned)
            kept = bounded(self.grey, grown, self.beside)
            banned |= _pairs(grown.index[~kept])
            grown = grown.select(kept)
            if len(grown) <= len(lattice):
                return grown
            if len(grown) >= doubled:
                if disorder(grown) > DISORDER:
                    return grown
                doubled = 2 * len(grown)
            lattice = grown

    def _ring(self, lattice: Lattice, banned: set[tuple[int, int]]) -> Lattice:
        """``lattice`` with the corners found one step, or else two steps, beyond its own."""
        for reach in (1, 2):
            beyond = frontier(lattice.index, reach, banned)
            if not len(beyond):
                continue
            expected = predict(lattice.index, lattice.uv, beyond)
            uv, found = self.match(beyond, expected, lattice)
            if not found.any() and len(lattice) >= FEWEST:
                uv, found = self._search(beyond, expected, lattice)
            if found.any():
                return lattice.joined(beyond[found], uv[found])
        return lattice

    def match(self, index: Ints, expected: Prediction, lattice: Lattice) -> tuple[Floats, Bools]:
        """The candidates inside the gates, with the colours and edges that belong there."""
        distance, nearest = self.tree.query(expected.uv)
        hessian = expected.jacobian.transpose(0, 2, 1) @ self.candidates.hessian[nearest] @ expected.jacobian
        mixed = hessian[:, 0, 1] * signs(index, lattice.phase)
        straight = np.maximum(np.abs(hessian[:, 0, 0]), np.abs(hessian[:, 1, 1])) < mixed
        found = (distance < gate(expected)) & straight
        found &= _first_of_each(nearest, distance)
        return self.candidates.uv[nearest], found

    def _search(self, index: Ints, expected: Prediction, lattice: Lattice) -> tuple[Floats, Bools]:
        """Saddles fitted at the predicted places, in windows of the predicted scale and shear."""
        frames = WINDOW * expected.jacobian
        inside = _inside(self.grey, expected.uv, frames)
        known, _ = local_frames(lattice.index, lattice.uv)
        usual = np.median(np.abs(saddle_strength(self.grey, lattice.uv, WINDOW * known)))
        frames[~inside] = np.eye(2)
        saddles = refine_saddles(self.grey, expected.uv, frames)
        strength = saddles.strength * signs(index, lattice.phase)
        near = np.linalg.norm(saddles.uv - expected.uv, axis=1) < gate(expected)
        clear = (strength > 0.2 * usual) & (saddles.residual < 0.35 * strength)
        return saddles.uv, inside & saddles.sound & near & clear


def grower(grey: Grey, candidates: Candidates, *, beside: float = BESIDE) -> Grower:
    """A grower over ``grey`` with an index of its ``candidates``."""
    return Grower(grey, candidates, cKDTree(candidates.uv), beside)


def disorder(lattice: Lattice) -> float:
    """Median distance of corners from where the others predict them, as a fraction of the spacing."""
    expected = predict(lattice.index, lattice.uv, lattice.index, leave_out=True)
    return float(np.median(np.linalg.norm(lattice.uv - expected.uv, axis=1) / expected.spacing))


def regular(lattice: Lattice, at: Floats | None = None) -> Bools:
    """Which corners (n,) stand where the others, without them, predict them; the worst of each place is not.

    ``at`` (n, 2) are the corners' places on the board where these are not their indices.
    """
    if len(lattice) < 6:
        return np.ones(len(lattice), dtype=bool)
    at = lattice.index.astype(np.float64) if at is None else at
    expected = predict(at, lattice.uv, at, leave_out=True)
    miss = np.linalg.norm(lattice.uv - expected.uv, axis=1)
    score = miss / np.maximum(3 * expected.std, 0.05 * expected.spacing + 0.3)
    # A wrong corner spoils the predictions of its neighbours: of those that miss, only the worst nearby goes.
    close = (np.abs(at[:, None] - at[None]) <= 2).all(axis=2)
    worst = score >= np.where(close, score[None], 0).max(axis=1)
    return np.asarray((score <= 1) | ~worst)


def bounded(grey: Grey, lattice: Lattice, beside: float = BESIDE) -> Bools:
    """Which corners (n,) have black on one side and white on the other of most edges to their neighbours."""
    good, edges = np.zeros(len(lattice)), np.zeros(len(lattice))
    rises = [_edge_rises(grey, lattice, step, beside) for step in (SIDES[0], SIDES[1])]
    usual = np.median(np.concatenate([rise for _, _, rise in rises])) if edges.size else 0.0
    for start, end, rise in rises:
        for corner in (start, end):
            np.add.at(edges, corner, 1.0)
            np.add.at(good, corner, rise > max(0.3 * usual, 0.0))
    return np.asarray((good > 0) & (good >= edges / 2))


def _edge_rises(grey: Grey, lattice: Lattice, step: Ints, beside: float) -> tuple[Ints, Ints, Floats]:
    """For corners one ``step`` apart: their positions (m,) in ``lattice`` and the rise of grey from dark to
    bright.

    The rise is measured across the middle of the straight line between them, ``beside`` times the width of the squares
    to each side.
    """
    place = {pair: k for k, pair in enumerate(zip(*lattice.index.T.tolist(), strict=True))}
    di, dj = step.tolist()
    pairs = [(k, place[i + di, j + dj]) for (i, j), k in place.items() if (i + di, j + dj) in place]
    start, end = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    along = lattice.uv[end] - lattice.uv[start]
    # Towards the square that lies down and right of ``start``: below a row's edge, right of a column's.
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) * (1 if di else -1)
    squared = np.maximum((along**2).sum(axis=1), 1e-9)
    # Squares seen from a side are narrow: their width is their area over the edge's length.
    width = np.abs(np.linalg.det(local_frames(lattice.index, lattice.uv)[0][start])) / np.sqrt(squared)
    across *= (np.maximum(beside * width, 1.5) / np.sqrt(squared))[:, None]
    middle = lattice.uv[start][:, None] + along[:, None] * np.array([0.35, 0.5, 0.65])[:, None]
    difference = sample(grey, middle + across[:, None]) - sample(grey, middle - across[:, None])
    return start, end, difference.mean(axis=1) * signs(lattice.index[start], lattice.phase)


def _seeds(candidates: Candidates, links: Ints) -> Ints:
    """Candidates with neighbours on all four sides that know them too, the most regular first."""
    complete = np.flatnonzero((links >= 0).all(axis=1))
    around = links[complete]
    mutual = (links[around] == complete[:, None, None]).any(axis=2).all(axis=1)
    complete, around = complete[mutual], around[mutual]
    place = candidates.uv[around]
    skew = np.linalg.norm(place[:, :2] + place[:, 2:] - 2 * candidates.uv[complete][:, None], axis=2)
    irregular = (skew / np.linalg.norm(place[:, :2] - place[:, 2:], axis=2)).max(axis=1)
    kept = irregular < 0.25
    return np.asarray(complete[kept][np.argsort(irregular[kept])])


def _first_cross(candidates: Candidates, links: Ints, seed: int) -> Lattice:
    index = np.concatenate([[[0, 0]], SIDES])
    return Lattice(index, candidates.uv[[seed, *links[seed]]], np.ones(5), 1)


def frontier(index: Ints, reach: int, banned: set[tuple[int, int]]) -> Ints:
    """Indices (m, 2) exactly ``reach`` steps along a row or column from a known one, and not yet known."""
    known = _pairs(index)
    around = {(i + reach * int(di), j + reach * int(dj)) for i, j in known for di, dj in SIDES}
    return np.array(sorted(around - known - banned), dtype=np.int64).reshape(-1, 2)


def _pairs(index: Ints) -> set[tuple[int, int]]:
    return {(int(i), int(j)) for i, j in index}


def signs(index: Ints, phase: int) -> Floats:
    """+1 where the squares up-left and down-right of an index are bright, else -1."""
    return np.where(index.sum(axis=1) % 2 == 0, 1.0, -1.0) * phase


def gate(expected: Prediction) -> Floats:
    """How far (m,) px from a prediction a corner may be."""
    low, high = GATE
    return np.clip(6 * expected.std, low * expected.spacing, high * expected.spacing)


def _inside(grey: Grey, uv: Floats, frames: Floats) -> Bools:
    """Whether the windows (N, 2, 2) around ``uv`` lie in the image and are no degenerate slivers."""
    reach = np.abs(frames).sum(axis=2)
    size = np.array([grey.shape[1], grey.shape[0]]) - 1
    wide = np.linalg.norm(frames, axis=1).min(axis=1) >= 1.5
    area = np.abs(np.linalg.det(frames)) > 0.15 * np.prod(np.linalg.norm(frames, axis=1), axis=1)
    return np.asarray(((uv > reach) & (uv < size - reach)).all(axis=1) & wide & area)


def _first_of_each(nearest: Ints, distance: Floats) -> Bools:
    """Of the places that share a nearest candidate, the closest."""
    order = np.argsort(distance)
    first = np.zeros(len(nearest), dtype=bool)
    first[order[np.unique(nearest[order], return_index=True)[1]]] = True
    return first
