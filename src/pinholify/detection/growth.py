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
from pinholify.detection.saddle import refine_saddles, saddle_strength

FEWEST = 9
"""Corners below which a lattice is no evidence of a board."""

MOST_SEEDS = 40
"""Seeds tried in one image."""

SIDES = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])

GATE = (0.1, 0.4)
"""The gate around a prediction is six standard deviations, within these fractions of the spacing."""

WINDOW = 0.25
"""Half window of the search at a predicted place, as a fraction of the spacing."""


@dataclass(frozen=True, slots=True, eq=False)
class Grower:
    """Grows lattices over one image: its ``grey`` levels and its ``candidates``."""

    grey: Grey
    candidates: Candidates
    tree: cKDTree

    def lattices(self) -> Iterator[Lattice]:
        """Lattices of at least FEWEST corners, from the most regular seed on; no candidate is used twice."""
        links = neighbours(self.candidates)
        free = np.ones(len(self.candidates), dtype=bool)
        tried = 0
        for seed in _seeds(self.candidates, links):
            if not free[seed] or tried == MOST_SEEDS:
                continue
            tried += 1
            lattice = self.grow(_first_cross(self.candidates, links, seed))
            if len(lattice) < FEWEST:
                free[seed] = False
                continue
            near = self.tree.query_ball_point(lattice.uv, 3.0)
            free[[i for group in near for i in group]] = False
            yield lattice

    def grow(self, lattice: Lattice) -> Lattice:
        """``lattice`` with every corner that can be reached from it, without those that break it."""
        banned: set[tuple[int, int]] = set()
        while True:
            grown = self._ring(lattice, banned)
            if len(grown) > len(lattice):
                lattice = grown
                continue
            kept = regular(lattice)
            if kept.all():
                return lattice
            banned |= {(int(i), int(j)) for i, j in lattice.index[~kept]}
            lattice = lattice.select(kept)
            if len(lattice) < 5:
                return lattice

    def _ring(self, lattice: Lattice, banned: set[tuple[int, int]]) -> Lattice:
        """``lattice`` with the corners found one step, or else two steps, beyond its own."""
        for reach in (1, 2):
            frontier = _frontier(lattice.index, reach, banned)
            if not len(frontier):
                continue
            expected = predict(lattice.index, lattice.uv, frontier)
            uv, found = self._match(frontier, expected, lattice)
            again = np.flatnonzero(~found)
            if len(again) and len(lattice) >= FEWEST:
                uv[again], found[again] = self._search(frontier[again], expected.select(again), lattice)
            if found.any():
                return lattice.joined(frontier[found], uv[found])
        return lattice

    def _match(self, index: Ints, expected: Prediction, lattice: Lattice) -> tuple[Floats, Bools]:
        """The candidates inside the gates, with the colours and edges that belong there."""
        distance, nearest = self.tree.query(expected.uv)
        hessian = expected.jacobian.transpose(0, 2, 1) @ self.candidates.hessian[nearest] @ expected.jacobian
        mixed = hessian[:, 0, 1] * signs(index, lattice.phase)
        straight = np.maximum(np.abs(hessian[:, 0, 0]), np.abs(hessian[:, 1, 1])) < mixed
        found = (distance < _gate(expected)) & straight
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
        near = np.linalg.norm(saddles.uv - expected.uv, axis=1) < _gate(expected)
        clear = (strength > 0.2 * usual) & (saddles.residual < 0.35 * strength)
        return saddles.uv, inside & saddles.sound & near & clear


def grower(grey: Grey, candidates: Candidates) -> Grower:
    """A grower over ``grey`` with an index of its ``candidates``."""
    return Grower(grey, candidates, cKDTree(candidates.uv))


def regular(lattice: Lattice) -> Bools:
    """Which corners (n,) stand where the others, without them, predict them; the worst of each place is not.
    """
    if len(lattice) < 6:
        return np.ones(len(lattice), dtype=bool)
    expected = predict(lattice.index, lattice.uv, lattice.index, leave_out=True)
    miss = np.linalg.norm(lattice.uv - expected.uv, axis=1)
    score = miss / np.maximum(3 * expected.std, 0.05 * expected.spacing + 0.3)
    # A wrong corner spoils the predictions of its neighbours: of those that miss, only the worst nearby goes.
    close = (np.abs(lattice.index[:, None] - lattice.index[None]) <= 2).all(axis=2)
    worst = score >= np.where(close, score[None], 0).max(axis=1)
    return np.asarray((score <= 1) | ~worst)


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


def _frontier(index: Ints, reach: int, banned: set[tuple[int, int]]) -> Ints:
    """Indices (m, 2) exactly ``reach`` steps along a row or column from a known one, and not yet known."""
    known = {(int(i), int(j)) for i, j in index}
    around = {(i + reach * int(di), j + reach * int(dj)) for i, j in known for di, dj in SIDES}
    return np.array(sorted(around - known - banned), dtype=np.int64).reshape(-1, 2)


def signs(index: Ints, phase: int) -> Floats:
    """+1 where the squares up-left and down-right of an index are bright, else -1."""
    return np.where(index.sum(axis=1) % 2 == 0, 1.0, -1.0) * phase


def _gate(expected: Prediction) -> Floats:
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
