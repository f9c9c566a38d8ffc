"""Lattices grown from a seed, ring by ring, each next corner where the Gaussian process expects it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pinholify.arrays import Bools, Floats, Ints
from pinholify.detection.candidates import Candidates, neighbours
from pinholify.detection.intensity import Grey
from pinholify.detection.lattice import Lattice
from pinholify.detection.prediction import Prediction, predict
from pinholify.detection.saddle import refine_saddles, saddle_strength, sample

FEWEST_CORNERS = 9
"""Corners below which a lattice is no evidence of a board."""

MOST_SEEDS = 40
"""Seeds grown in one image."""

MOST_LARGEST = 20
"""The work in one image: as many corners as so many of the largest lattices have."""

CROSSES_APART = 4
"""Columns between crosses that are looked at together: none is next to another, and their colours are alike."""

LEAST_CONTRAST_RATIO = 0.5
"""The least ratio of the contrasts of two candidates that are taken for corners of one lattice before it is grown."""

MOST_DISORDER = 0.1
"""Above this a lattice is letters or leaves; the most bent photographs of boards stay below a third of it."""

MOST_REPAIRS = 5
"""Times that a lattice may lose corners which break it, and grow again."""

SIDES = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])

ROWS_PER_COLUMN = 2**32
"""Columns are counted in this many rows where a pair of indices has to be one number."""

GATE = (0.1, 0.4)
"""The gate around a prediction is six standard deviations, within these fractions of the spacing."""

BESIDE_EDGE = 0.125
"""How far beside an edge its colours are compared, as a fraction of the squares' width."""

STRENGTH_SAMPLES = 24
"""Corners that tell how strong the others of a lattice are."""

SEARCH_WINDOW = 0.25
"""Half window of the search at a predicted place, as a fraction of the spacing."""


@dataclass(frozen=True, slots=True, eq=False)
class Grower:
    """Grows lattices over one image: its ``grey`` levels and its ``candidates``.

    ``beside`` is how far to each side of an edge its colours are compared, as a fraction of the squares' width there.
    A lattice of more corners than ``most`` grows no further.
    """

    grey: Grey
    candidates: Candidates
    tree: cKDTree
    beside: float
    most: float

    def lattices(self) -> Iterator[Lattice]:
        """Lattices of at least FEWEST_CORNERS corners, from a seed of each group in turn; no candidate is used twice."""
        links = neighbours(self.candidates)
        free = np.ones(len(self.candidates), dtype=bool)
        tried, looked_at = 0, 0
        for seed in _in_turn(self.candidates, links, self._seeds(links)):
            if not free[seed]:
                continue
            if tried == MOST_SEEDS or looked_at > MOST_LARGEST * self.most:
                return
            lattice = self.grow(_first_cross(self.candidates, links, seed))
            tried, looked_at = tried + 1, looked_at + len(lattice)
            if len(lattice) < FEWEST_CORNERS or disorder(lattice) > MOST_DISORDER:
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
            if len(lattice) < FEWEST_CORNERS:
                break
            expected = left_out(lattice)
            if disorder(lattice, expected) > MOST_DISORDER:
                break
            kept = regular(lattice, expected=expected)
            if kept.all():
                break
            banned |= _pairs(lattice.index[~kept])
            lattice = lattice.select(kept)
        return lattice

    def _grow(self, lattice: Lattice, banned: set[tuple[int, int]]) -> Lattice:
        """``lattice`` with ring after ring of corners that stand at the ends of good edges, none in
        ``banned``.
        """
        doubled = 2 * FEWEST_CORNERS
        while True:
            grown = self._ring(lattice, banned)
            kept = bounded(self.grey, grown, self.beside)
            banned |= _pairs(grown.index[~kept])
            grown = grown.select(kept)
            if len(grown) <= len(lattice) or len(grown) > self.most:
                return grown
            if len(grown) >= doubled:
                if disorder(grown) > MOST_DISORDER:
                    return grown
                doubled = 2 * len(grown)
            lattice = grown

    def _seeds(self, links: Ints) -> Ints:
        """Regular candidates (n,), the most regular first, with black and white along the edges to all four
        neighbours.
        """
        seeds = _regular_crosses(self.candidates, links)
        if not len(seeds):
            return seeds
        # All crosses at once, as one lattice of which they are separate parts.
        cross = np.concatenate([[[0, 0]], SIDES])
        index = cross + np.arange(len(seeds))[:, None, None] * np.array([CROSSES_APART, 0])
        uv = self.candidates.uv[np.column_stack([seeds, links[seeds]])]
        crosses = Lattice(index.reshape(-1, 2), uv.reshape(-1, 2), np.ones(uv.size // 2), 1)
        rise = _rises(self.grey, crosses, self.beside)[2].reshape(2, len(seeds), 2)
        usual = np.median(rise, axis=(0, 2))
        return np.asarray(seeds[(rise > np.maximum(0.3 * usual, 0.0)[:, None]).all(axis=(0, 2))])

    def _ring(self, lattice: Lattice, banned: set[tuple[int, int]]) -> Lattice:
        """``lattice`` with the corners found one step, or else two steps, beyond its own."""
        for reach in (1, 2):
            beyond = frontier(lattice.index, reach, banned)
            if not len(beyond):
                continue
            expected = predict(lattice.index, lattice.uv, beyond)
            uv, found = self.match(beyond, expected, lattice)
            if not found.any() and len(lattice) >= FEWEST_CORNERS:
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
        frames = SEARCH_WINDOW * expected.jacobian
        inside = _inside(self.grey, expected.uv, frames)
        usual = self._usual_strength(lattice)
        frames[~inside] = np.eye(2)
        saddles = refine_saddles(self.grey, expected.uv, frames)
        strength = saddles.strength * signs(index, lattice.phase)
        near = np.linalg.norm(saddles.uv - expected.uv, axis=1) < gate(expected)
        clear = (strength > 0.2 * usual) & (saddles.residual < 0.35 * strength)
        return saddles.uv, inside & saddles.sound & near & clear

    def _usual_strength(self, lattice: Lattice) -> float:
        """Median of the saddles' strength at corners spread over ``lattice``, in grey levels."""
        some = lattice.select(np.arange(len(lattice)) % (1 + len(lattice) // STRENGTH_SAMPLES) == 0)
        frames = predict(lattice.index, lattice.uv, some.index).jacobian
        return float(np.median(np.abs(saddle_strength(self.grey, some.uv, SEARCH_WINDOW * frames))))


def grower(grey: Grey, candidates: Candidates, *, beside: float = BESIDE_EDGE, most: float = np.inf) -> Grower:
    """A grower over ``grey`` with an index of its ``candidates``, of lattices of about ``most`` corners at most."""
    return Grower(grey, candidates, cKDTree(candidates.uv), beside, most)


def left_out(lattice: Lattice, at: Floats | None = None) -> Prediction:
    """Where the other corners predict each corner; ``at`` (n, 2) as in :func:`regular`."""
    at = lattice.index.astype(np.float64) if at is None else at
    return predict(at, lattice.uv, at, leave_out=True)


def disorder(lattice: Lattice, expected: Prediction | None = None) -> float:
    """Median distance of corners from where the others predict them, as a fraction of the spacing."""
    expected = left_out(lattice) if expected is None else expected
    return float(np.median(np.linalg.norm(lattice.uv - expected.uv, axis=1) / expected.spacing))


def regular(lattice: Lattice, at: Floats | None = None, *, expected: Prediction | None = None) -> Bools:
    """Which corners (n,) stand where the others, without them, predict them; the worst of each place is not.

    ``at`` (n, 2) are the corners' places on the board where these are not their indices; ``expected`` is the
    prediction, where it is known already.
    """
    if len(lattice) < 6:
        return np.ones(len(lattice), dtype=bool)
    at = lattice.index.astype(np.float64) if at is None else at
    expected = left_out(lattice, at) if expected is None else expected
    miss = np.linalg.norm(lattice.uv - expected.uv, axis=1)
    score = miss / np.maximum(3 * expected.std, 0.05 * expected.spacing + 0.3)
    # A wrong corner spoils the predictions of its neighbours: of those that miss, only the worst nearby goes.
    kept = np.asarray(score <= 1)
    missing = np.flatnonzero(~kept)
    close = cKDTree(at).query_ball_point(at[missing], 2, p=np.inf)
    kept[missing] = [score[one] < score[near].max() for one, near in zip(missing, close, strict=True)]
    return kept


def bounded(grey: Grey, lattice: Lattice, beside: float = BESIDE_EDGE) -> Bools:
    """Which corners (n,) have black on one side and white on the other of most edges to their neighbours."""
    start, end, rise = _rises(grey, lattice, beside)
    if not len(rise):
        return np.zeros(len(lattice), dtype=bool)
    clear = rise > max(0.3 * np.median(rise), 0.0)
    corners, count = np.concatenate([start, end]), len(lattice)
    good, edges = np.bincount(corners, np.tile(clear, 2), count), np.bincount(corners, minlength=count)
    return np.asarray((good > 0) & (good >= edges / 2))


def _next_corners(index: Ints) -> tuple[Ints, Ints]:
    """Positions in ``index`` (n, 2) of the corners one column and one row on, and of those one back: (n, 2) each, -1
    where there is none.
    """
    at = index - index.min(axis=0) + 1
    table = np.full(at.max(axis=0) + 2, -1)
    table[tuple(at.T)] = np.arange(len(index))
    after, before = (np.stack([table[tuple((at + way * step).T)] for step in SIDES[:2]], axis=1) for way in (1, -1))
    return after, before


def _areas(uv: Floats, after: Ints, before: Ints) -> Floats:
    """The area (n,) in px² of a square at each corner, by differences to its neighbours; nan where it has none along a
    row or a column.
    """
    count = (after >= 0).astype(np.float64) + (before >= 0)
    apart = np.where((after >= 0)[:, :, None], uv[after], uv[:, None])
    apart -= np.where((before >= 0)[:, :, None], uv[before], uv[:, None])
    across = apart[:, 0, 0] * apart[:, 1, 1] - apart[:, 0, 1] * apart[:, 1, 0]
    steps = count.prod(axis=1)
    return np.where(steps > 0, np.abs(across) / np.maximum(steps, 1.0), np.nan)


def _rises(grey: Grey, lattice: Lattice, beside: float) -> tuple[Ints, Ints, Floats]:
    """As :func:`_edge_rises`, for the edges along all rows and then for those along all columns."""
    after, before = _next_corners(lattice.index)
    area = _areas(lattice.uv, after, before)
    sides = [_edge_rises(grey, lattice, after[:, axis], area, beside, side) for axis, side in enumerate((1, -1))]
    start, end, rise = zip(*sides, strict=True)
    return np.concatenate(start), np.concatenate(end), np.concatenate(rise)


def _edge_rises(
    grey: Grey, lattice: Lattice, after: Ints, area: Floats, beside: float, side: int
) -> tuple[Ints, Ints, Floats]:
    """For the edges from corners to those ``after`` them: both positions (m,) in ``lattice`` and the rise of grey from
    dark to bright.

    The rise is measured across the middle of the straight line between them, ``beside`` times the width of the squares
    to each side. ``side`` is +1 along rows and -1 along columns.
    """
    start = np.flatnonzero(after >= 0)
    end = after[start]
    along = lattice.uv[end] - lattice.uv[start]
    # Towards the square that lies down and right of ``start``: below a row's edge, right of a column's.
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) * side
    squared = np.maximum((along**2).sum(axis=1), 1e-9)
    # Squares seen from a side are narrow: their width is their area over the edge's length.
    square = np.where(np.isnan(area[start]), area[end], area[start])
    width = np.where(np.isnan(square), squared, square) / np.sqrt(squared)
    across *= (np.maximum(beside * width, 1.5) / np.sqrt(squared))[:, None]
    middle = lattice.uv[start][:, None] + along[:, None] * np.array([0.35, 0.5, 0.65])[:, None]
    difference = sample(grey, middle + across[:, None]) - sample(grey, middle - across[:, None])
    return start, end, difference.mean(axis=1) * signs(lattice.index[start], lattice.phase)


def _regular_crosses(candidates: Candidates, links: Ints) -> Ints:
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


def _in_turn(candidates: Candidates, links: Ints, seeds: Ints) -> Ints:
    """``seeds`` in another order: the first of each group of linked candidates, the group that covers most of the image
    first, then the second of each, and so on.

    So a pattern behind a board, of far more seeds, takes few more turns than the board.
    """
    group = _groups(candidates, links)[seeds]
    by_group = np.argsort(group, kind="stable")
    turn = np.empty(len(seeds), dtype=np.int64)
    turn[by_group] = np.arange(len(seeds)) - np.searchsorted(group[by_group], group[by_group])
    right, down, left, up = candidates.uv[links[seeds]].transpose(1, 2, 0)
    (across_u, across_v), (along_u, along_v) = right - left, down - up
    covered = np.bincount(group, np.abs(across_u * along_v - across_v * along_u))[group]
    return np.asarray(seeds[np.lexsort((group, -covered, turn))])


def _groups(candidates: Candidates, links: Ints) -> Ints:
    """A number (n,) for each candidate, the same for those that are linked both ways and of like contrast."""
    start, side = np.nonzero(links >= 0)
    end = links[start, side]
    contrast = candidates.contrast
    kept = (links[end] == start[:, None]).any(axis=1)
    kept &= np.minimum(contrast[start], contrast[end]) > LEAST_CONTRAST_RATIO * np.maximum(contrast[start], contrast[end])
    count = len(candidates)
    graph = csr_array((np.ones(kept.sum(), dtype=bool), (start[kept], end[kept])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _first_cross(candidates: Candidates, links: Ints, seed: int) -> Lattice:
    index = np.concatenate([[[0, 0]], SIDES])
    return Lattice(index, candidates.uv[[seed, *links[seed]]], np.ones(5), 1)


def frontier(index: Ints, reach: int, banned: set[tuple[int, int]]) -> Ints:
    """Indices (m, 2) exactly ``reach`` steps along a row or column from a known one, and not yet known."""
    around = (index[:, None] + reach * SIDES).reshape(-1, 2)
    taken = np.concatenate([index, np.array(sorted(banned), dtype=np.int64).reshape(-1, 2)])
    # One number for a pair, in the order of pairs.
    new = np.setdiff1d(around @ [ROWS_PER_COLUMN, 1], taken @ [ROWS_PER_COLUMN, 1])
    column = (new + ROWS_PER_COLUMN // 2) // ROWS_PER_COLUMN
    return np.stack([column, new - column * ROWS_PER_COLUMN], axis=1)


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
