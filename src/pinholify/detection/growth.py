"""Lattices grown from a seed, ring by ring, each next corner where the Gaussian process predicts it."""

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

MIN_LATTICE_CORNERS = 9
"""Corners below which a lattice is not evidence of a board."""

MAX_SEEDS = 40
"""Seeds grown in one image."""

MAX_LARGEST_LATTICES = 20
"""Limit of the work on one image: the corners of this many lattices of the largest size."""

CROSSES_APART = 4
"""Columns between crosses that are checked together: they do not touch, and have the same colours."""

MIN_CONTRAST_RATIO = 0.5
"""Smallest ratio of the contrasts of two candidates that are linked as corners of one lattice before it is grown."""

MAX_DISORDER = 0.1
"""A lattice with more :func:`disorder` is text or leaves; boards stay below a third of it even through strong fisheyes.
"""

MAX_REPAIRS = 5
"""How often a lattice may lose irregular corners and grow again."""

SIDES = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])

ROWS_PER_COLUMN = 2**32
"""Factor of the column where a pair of indices has to be one number: more than there can be rows."""

GATE = (0.1, 0.4)
"""The gate around a prediction is six standard deviations, limited to these fractions of the spacing."""

BESIDE_EDGE = 0.125
"""Distance from an edge at which its colours are compared, as a fraction of the squares' width."""

STRENGTH_SAMPLES = 24
"""Corners from which the usual strength in a lattice is estimated."""

SEARCH_WINDOW = 0.25
"""Half window of the search at a predicted corner, as a fraction of the spacing."""


@dataclass(frozen=True, slots=True, eq=False)
class Grower:
    """Grows lattices over one image, given its ``grey`` levels and its ``candidates``, of which ``tree`` is the index.

    ``beside`` is the distance from an edge at which its colours are compared, as a fraction of the local width of the
    squares. A lattice of more corners than ``most`` is not grown further.
    """

    grey: Grey
    candidates: Candidates
    tree: cKDTree
    beside: float
    most: float

    def lattices(self) -> Iterator[Lattice]:
        """Lattices of at least MIN_LATTICE_CORNERS, from a seed of each group in turn; no candidate is used twice."""
        links = neighbours(self.candidates)
        free = np.ones(len(self.candidates), dtype=bool)
        tried, looked_at = 0, 0
        for seed in _in_turn(self.candidates, links, self._seeds(links)):
            if not free[seed]:
                continue
            if tried == MAX_SEEDS or looked_at > MAX_LARGEST_LATTICES * self.most:
                return
            lattice = self.grow(_first_cross(self.candidates, links, seed))
            tried, looked_at = tried + 1, looked_at + len(lattice)
            if len(lattice) < MIN_LATTICE_CORNERS or disorder(lattice) > MAX_DISORDER:
                free[seed] = False
                continue
            near = self.tree.query_ball_point(lattice.uv, 3.0)
            free[[i for group in near for i in group]] = False
            yield lattice

    def grow(self, lattice: Lattice) -> Lattice:
        """``lattice`` with every corner that can be reached from it, without irregular ones."""
        banned: set[tuple[int, int]] = set()
        for _ in range(MAX_REPAIRS):
            lattice = self._grow(lattice, banned)
            if len(lattice) < MIN_LATTICE_CORNERS:
                break
            expected = left_out(lattice)
            if disorder(lattice, expected) > MAX_DISORDER:
                break
            kept = regular(lattice, expected=expected)
            if kept.all():
                break
            banned |= _pairs(lattice.index[~kept])
            lattice = lattice.select(kept)
        return lattice

    def _grow(self, lattice: Lattice, banned: set[tuple[int, int]]) -> Lattice:
        """``lattice`` with ring after ring of corners at the ends of good edges, none of them ``banned``."""
        doubled = 2 * MIN_LATTICE_CORNERS
        while True:
            grown = self._ring(lattice, banned)
            kept = bounded(self.grey, grown, self.beside)
            banned |= _pairs(grown.index[~kept])
            grown = grown.select(kept)
            if len(grown) <= len(lattice) or len(grown) > self.most:
                return grown
            if len(grown) >= doubled:
                if disorder(grown) > MAX_DISORDER:
                    return grown
                doubled = 2 * len(grown)
            lattice = grown

    def _seeds(self, links: Ints) -> Ints:
        """Regular candidates (n,), the most regular first, with black and white beside the edges to all neighbours."""
        seeds = _regular_crosses(self.candidates, links)
        if not len(seeds):
            return seeds
        # All crosses at once, as separate parts of one lattice.
        cross = np.concatenate([[[0, 0]], SIDES])
        index = cross + np.arange(len(seeds))[:, None, None] * np.array([CROSSES_APART, 0])
        uv = self.candidates.uv[np.column_stack([seeds, links[seeds]])]
        crosses = Lattice(index.reshape(-1, 2), uv.reshape(-1, 2), np.ones(uv.size // 2), 1)
        rise = _rises(self.grey, crosses, self.beside)[2].reshape(2, len(seeds), 2)
        usual = np.median(rise, axis=(0, 2))
        return np.asarray(seeds[(rise > np.maximum(0.3 * usual, 0.0)[:, None]).all(axis=(0, 2))])

    def _ring(self, lattice: Lattice, banned: set[tuple[int, int]]) -> Lattice:
        """``lattice`` with the corners found one step, or failing that two steps, beyond it."""
        for reach in (1, 2):
            beyond = frontier(lattice.index, reach, banned)
            if not len(beyond):
                continue
            expected = predict(lattice.index, lattice.uv, beyond)
            uv, found = self.match(beyond, expected, lattice)
            if not found.any() and len(lattice) >= MIN_LATTICE_CORNERS:
                uv, found = self._search(beyond, expected, lattice)
            if found.any():
                return lattice.joined(beyond[found], uv[found])
        return lattice

    def match(self, index: Ints, expected: Prediction, lattice: Lattice) -> tuple[Floats, Bools]:
        """The nearest candidates (n, 2) px, and which (n,) are inside the gates with the right colours and edges."""
        distance, nearest = self.tree.query(expected.uv)
        hessian = expected.jacobian.transpose(0, 2, 1) @ self.candidates.hessian[nearest] @ expected.jacobian
        mixed = hessian[:, 0, 1] * signs(index, lattice.phase)
        straight = np.maximum(np.abs(hessian[:, 0, 0]), np.abs(hessian[:, 1, 1])) < mixed
        found = (distance < gate(expected)) & straight
        found &= _first_of_each(nearest, distance)
        return self.candidates.uv[nearest], found

    def _search(self, index: Ints, expected: Prediction, lattice: Lattice) -> tuple[Floats, Bools]:
        """Saddles (n, 2) px fitted in windows of the predicted position, scale and shear, and which (n,) are good."""
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
        """Median strength of the saddles at corners spread over ``lattice``, in grey levels."""
        some = lattice.select(np.arange(len(lattice)) % (1 + len(lattice) // STRENGTH_SAMPLES) == 0)
        frames = predict(lattice.index, lattice.uv, some.index).jacobian
        return float(np.median(np.abs(saddle_strength(self.grey, some.uv, SEARCH_WINDOW * frames))))


def grower(grey: Grey, candidates: Candidates, *, beside: float = BESIDE_EDGE, most: float = np.inf) -> Grower:
    """A :class:`Grower` over ``grey`` and its ``candidates``, for lattices of about ``most`` corners at most."""
    return Grower(grey, candidates, cKDTree(candidates.uv), beside, most)


def left_out(lattice: Lattice, at: Floats | None = None) -> Prediction:
    """Each corner as predicted by the others; ``at`` (n, 2) as in :func:`regular`."""
    at = lattice.index.astype(np.float64) if at is None else at
    return predict(at, lattice.uv, at, leave_out=True)


def disorder(lattice: Lattice, expected: Prediction | None = None) -> float:
    """Median distance of corners from where the others predict them, as a fraction of the spacing."""
    expected = left_out(lattice) if expected is None else expected
    return float(np.median(np.linalg.norm(lattice.uv - expected.uv, axis=1) / expected.spacing))


def regular(lattice: Lattice, at: Floats | None = None, *, expected: Prediction | None = None) -> Bools:
    """Which corners (n,) are where the others predict them; of neighbours that are not, only the worst is False.

    ``at`` (n, 2) are the corners' positions on the board where these are not their indices; ``expected`` is the
    prediction, if it is already known.
    """
    if len(lattice) < 6:
        return np.ones(len(lattice), dtype=bool)
    at = lattice.index.astype(np.float64) if at is None else at
    expected = left_out(lattice, at) if expected is None else expected
    miss = np.linalg.norm(lattice.uv - expected.uv, axis=1)
    score = miss / np.maximum(3 * expected.std, 0.05 * expected.spacing + 0.3)
    # A wrong corner spoils the predictions of its neighbours: of those that miss, only the worst nearby is dropped.
    kept = np.asarray(score <= 1)
    missing = np.flatnonzero(~kept)
    close = cKDTree(at).query_ball_point(at[missing], 2, p=np.inf)
    kept[missing] = [score[one] < score[near].max() for one, near in zip(missing, close, strict=True)]
    return kept


def bounded(grey: Grey, lattice: Lattice, beside: float = BESIDE_EDGE) -> Bools:
    """Which corners (n,) have black on one side and white on the other side of most edges to their neighbours."""
    start, end, rise = _rises(grey, lattice, beside)
    if not len(rise):
        return np.zeros(len(lattice), dtype=bool)
    clear = rise > max(0.3 * np.median(rise), 0.0)
    corners, count = np.concatenate([start, end]), len(lattice)
    good, edges = np.bincount(corners, np.tile(clear, 2), count), np.bincount(corners, minlength=count)
    return np.asarray((good > 0) & (good >= edges / 2))


def _next_corners(index: Ints) -> tuple[Ints, Ints]:
    """Positions in ``index`` (n, 2) of the corners one column and one row on, and of those one back.

    Both are (n, 2), and -1 where there is none.
    """
    at = index - index.min(axis=0) + 1
    table = np.full(at.max(axis=0) + 2, -1)
    table[tuple(at.T)] = np.arange(len(index))
    after, before = (np.stack([table[tuple((at + way * step).T)] for step in SIDES[:2]], axis=1) for way in (1, -1))
    return after, before


def _areas(uv: Floats, after: Ints, before: Ints) -> Floats:
    """Area (n,) in px² of a square at each corner, from its neighbours; nan where a row or column has none."""
    count = (after >= 0).astype(np.float64) + (before >= 0)
    apart = np.where((after >= 0)[:, :, None], uv[after], uv[:, None])
    apart -= np.where((before >= 0)[:, :, None], uv[before], uv[:, None])
    across = apart[:, 0, 0] * apart[:, 1, 1] - apart[:, 0, 1] * apart[:, 1, 0]
    steps = count.prod(axis=1)
    return np.where(steps > 0, np.abs(across) / np.maximum(steps, 1.0), np.nan)


def _rises(grey: Grey, lattice: Lattice, beside: float) -> tuple[Ints, Ints, Floats]:
    """:func:`_edge_rises` of the edges along all rows, followed by those along all columns."""
    after, before = _next_corners(lattice.index)
    area = _areas(lattice.uv, after, before)
    sides = [_edge_rises(grey, lattice, after[:, axis], area, beside, side) for axis, side in enumerate((1, -1))]
    start, end, rise = zip(*sides, strict=True)
    return np.concatenate(start), np.concatenate(end), np.concatenate(rise)


def _edge_rises(
    grey: Grey, lattice: Lattice, after: Ints, area: Floats, beside: float, side: int
) -> tuple[Ints, Ints, Floats]:
    """Positions (m,) in ``lattice`` of both ends of edges, and the rise (m,) of grey from dark to bright across them.

    The edges run from corners to those ``after`` them. The rise is measured across the middle of the straight line
    between them, ``beside`` times the width of the squares to each side. ``side`` is +1 along rows, -1 along columns.
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
    """Candidates with mutual neighbours on all four sides, the most regular first."""
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
    """``seeds`` reordered: the first of each group of linked candidates, then the second of each, and so on.

    The group that covers most of the image comes first. A pattern behind a board, which has far more seeds, therefore
    takes little more time than the board.
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
    """A group number (n,) for each candidate; candidates linked in both directions, of similar contrast, share one."""
    start, side = np.nonzero(links >= 0)
    end = links[start, side]
    contrast = candidates.contrast
    kept = (links[end] == start[:, None]).any(axis=1)
    lower, higher = np.minimum(contrast[start], contrast[end]), np.maximum(contrast[start], contrast[end])
    kept &= lower > MIN_CONTRAST_RATIO * higher
    count = len(candidates)
    graph = csr_array((np.ones(kept.sum(), dtype=bool), (start[kept], end[kept])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _first_cross(candidates: Candidates, links: Ints, seed: int) -> Lattice:
    index = np.concatenate([[[0, 0]], SIDES])
    return Lattice(index, candidates.uv[[seed, *links[seed]]], np.ones(5), 1)


def frontier(index: Ints, reach: int, banned: set[tuple[int, int]]) -> Ints:
    """Indices (m, 2) exactly ``reach`` steps along a row or column from a known one, neither known nor ``banned``."""
    around = (index[:, None] + reach * SIDES).reshape(-1, 2)
    taken = np.concatenate([index, np.array(sorted(banned), dtype=np.int64).reshape(-1, 2)])
    # One number per pair, in the order of the pairs.
    new = np.setdiff1d(around @ [ROWS_PER_COLUMN, 1], taken @ [ROWS_PER_COLUMN, 1])
    column = (new + ROWS_PER_COLUMN // 2) // ROWS_PER_COLUMN
    return np.stack([column, new - column * ROWS_PER_COLUMN], axis=1)


def _pairs(index: Ints) -> set[tuple[int, int]]:
    return {(int(i), int(j)) for i, j in index}


def signs(index: Ints, phase: int) -> Floats:
    """+1 (n,) where the squares up-left and down-right of an index (n, 2) are bright, else -1."""
    return np.where(index.sum(axis=1) % 2 == 0, 1.0, -1.0) * phase


def gate(expected: Prediction) -> Floats:
    """Largest accepted distance (m,) in px of a corner from its prediction."""
    low, high = GATE
    return np.clip(6 * expected.std, low * expected.spacing, high * expected.spacing)


def _inside(grey: Grey, uv: Floats, frames: Floats) -> Bools:
    """Whether the windows ``frames`` (N, 2, 2) around ``uv`` (N, 2) lie in the image and are not degenerate."""
    reach = np.abs(frames).sum(axis=2)
    size = np.array([grey.shape[1], grey.shape[0]]) - 1
    wide = np.linalg.norm(frames, axis=1).min(axis=1) >= 1.5
    area = np.abs(np.linalg.det(frames)) > 0.15 * np.prod(np.linalg.norm(frames, axis=1), axis=1)
    return np.asarray(((uv > reach) & (uv < size - reach)).all(axis=1) & wide & area)


def _first_of_each(nearest: Ints, distance: Floats) -> Bools:
    """Which (n,) are the closest of those with the same ``nearest`` (n,) candidate."""
    order = np.argsort(distance)
    first = np.zeros(len(nearest), dtype=bool)
    first[order[np.unique(nearest[order], return_index=True)[1]]] = True
    return first
