"""Circle grids: discs that form a lattice, grown as a checkerboard's corners are, and its place on the board.

Each disc's own outline tells how the sheet is foreshortened there. In that frame the four nearest neighbours stand
in a cross, which seeds a lattice at any slant; an asymmetric grid's is turned by 45°. From there the Gaussian process
predicts each next disc, and what is there is fitted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import CircleGrid, lattice
from pinholify.corners import Corners, not_found
from pinholify.detection.discs import Discs, find_discs, fit_discs
from pinholify.detection.growth import FEWEST, MOST_REPAIRS, SIDES, frontier, gate
from pinholify.detection.intensity import Grey, grey_levels
from pinholify.detection.lattice import Lattice
from pinholify.detection.placement import FEWEST_OF_PART, LARGER
from pinholify.detection.prediction import local_frames, predict
from pinholify.detection.refine import FLOOR
from pinholify.detection.saddle import sample

FIRST_SIDE = 2000
"""Discs are looked for in an image reduced by a power of two to at most this width and height (px)."""

MOST_SEEDS = 40
NEIGHBOURS = 8

SQUARE = 30.0
"""Degrees by which the arms of a seed's cross may fail to be a quarter turn apart in the frame of its disc."""

REACH = 0.75
"""Of the spacing: how far from its prediction the nearest disc may be, no other one being nearer."""

EVEN = 1.25
"""The distances of neighbours, in radii, differ by less than this factor from the usual one."""

DIAMETER_MISMATCH = 0.15
"""Share by which the diameter of the discs may differ from the board's: their centres are corrected for it."""

ROUGH = 3.0
"""A disc so many times less well known than the usual one is covered in part."""

PALE = 0.25
"""Of the contrast. A place in the image no darker than that holds no disc."""


def detect_circles(image: NDArray[Any], board: CircleGrid, *, name: str, mirrored: bool) -> Corners:
    """The centroids of the discs of ``board`` in ``image``, by their ids.

    ``image`` and the result are as of :func:`pinholify.detection.detect_board`.
    """
    grey = grey_levels(image)
    best = not_found(name, f"no grid of {board.spec} was found")
    for discs in _searches(grey):
        for grown in _lattices(grey, discs):
            found = _placed(grey, grown, board, name=name, mirrored=mirrored)
            best = found if len(found) > len(best) or not best.found else best
        if len(best) == board.columns * board.rows:
            break
    return best


def _searches(grey: Grey) -> Iterator[Discs]:
    """The discs in ``grey``, found in a reduced image first, and then, where that is another, at full size."""
    factor = 1
    while max(grey.shape) / factor > FIRST_SIDE:
        factor *= 2
    if factor > 1:
        size = (grey.shape[1] // factor, grey.shape[0] // factor)
        whole = grey[: size[1] * factor, : size[0] * factor]
        discs = find_discs(np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), dtype=np.float32))
        larger = fit_discs(grey, (discs.uv + 0.5) * factor - 0.5, discs.axes * factor)
        yield larger.select(larger.sound)
    yield find_discs(grey)


# --- growth -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Grown:
    """A lattice and the discs at its points, in one order."""

    lattice: Lattice
    discs: Discs

    def select(self, keep: Bools) -> _Grown:
        return _Grown(self.lattice.select(keep), self.discs.select(keep))

    def diameters(self) -> Floats:
        """(n,) in steps of the lattice."""
        jacobian, _ = local_frames(self.lattice.index, self.lattice.uv)
        return np.asarray(2.0 * np.sqrt(self.discs.areas / np.abs(np.linalg.det(jacobian))))

    def usual_arm(self) -> float:
        """The median distance of neighbours, in radii."""
        return float(np.median(self._arms()[2]))

    def even(self) -> Bools:
        """Which discs (n,) are as far from most of their neighbours as the others are from theirs."""
        first, second, arms = self._arms()
        fits = np.abs(np.log(arms / np.median(arms))) < np.log(EVEN)
        good, all_arms = np.zeros(len(self.discs)), np.zeros(len(self.discs))
        for end in (first, second):
            np.add.at(good, end, fits)
            np.add.at(all_arms, end, 1)
        return np.asarray(2 * good > all_arms)

    def _arms(self) -> tuple[Ints, Ints, Floats]:
        """Pairs of neighbours and their distances in radii."""
        first, second = cKDTree(self.lattice.index).query_pairs(1.01, output_type="ndarray").T
        return first, second, _radii_between(self.discs.select(first), self.discs.select(second))


def _radii_between(a: Discs, b: Discs) -> Floats:
    """Distances (n,) between discs in radii, the mean of what each pair's own foreshortenings say."""
    offset = (b.uv - a.uv)[:, :, None]
    lengths = [np.linalg.norm(np.linalg.solve(discs.axes, offset)[:, :, 0], axis=1) for discs in (a, b)]
    return np.asarray(np.mean(lengths, axis=0))


def _lattices(grey: Grey, discs: Discs) -> Iterator[_Grown]:
    """Lattices of at least FEWEST discs, from the most regular seed on; no disc is used twice."""
    if len(discs) < FEWEST:
        return
    tree = cKDTree(discs.uv)
    free = np.ones(len(discs), dtype=bool)
    seeds, crosses = _seeds(discs, tree)
    for seed, cross in list(zip(seeds.tolist(), crosses, strict=True))[:MOST_SEEDS]:
        if not free[seed]:
            continue
        start = np.array([seed, *cross])
        index = np.concatenate([[[0, 0]], SIDES])
        grown = _grow(grey, discs, tree, _Grown(_plain(index, discs.uv[start]), discs.select(start)))
        used = tree.query_ball_point(grown.lattice.uv, 2.0)
        free[[i for group in used for i in group]] = False
        if len(grown.lattice) >= FEWEST:
            yield _fitted(grey, grown)


def _fitted(grey: Grey, grown: _Grown) -> _Grown:
    """``grown`` with each disc fitted once more, from where it was found, without those that something covers in part.

    A finger's edge in an outline makes it rougher than the others'.
    """
    discs = fit_discs(grey, grown.discs.uv, grown.discs.axes)
    fitted = _Grown(Lattice(grown.lattice.index, discs.uv, grown.lattice.weights, grown.lattice.phase), discs)
    rough = discs.std > ROUGH * np.median(discs.std) + FLOOR
    return fitted.select(discs.sound & ~rough)


def _plain(index: Ints, uv: Floats) -> Lattice:
    return Lattice(index, uv, np.ones(len(index)), 1)


def _seeds(discs: Discs, tree: cKDTree) -> tuple[Ints, Ints]:
    """Discs (m,) whose four nearest neighbours stand in a cross, and these (m, 4), clockwise; the best first."""
    near = tree.query(discs.uv, k=min(NEIGHBOURS + 1, len(discs)))[1][:, 1:]
    offset = np.linalg.solve(discs.axes, (discs.uv[near] - discs.uv[:, None]).transpose(0, 2, 1)).transpose(0, 2, 1)
    own = np.repeat(np.arange(len(discs)), near.shape[1])
    radii = _radii_between(discs.select(own), discs.select(near.ravel())).reshape(near.shape)
    nearest = np.argsort(radii, axis=1)[:, :4]
    rows = np.arange(len(discs))[:, None]
    arms, length, near = offset[rows, nearest], radii[rows, nearest], near[rows, nearest]
    angle = np.arctan2(arms[:, :, 1], arms[:, :, 0])
    order = np.argsort(angle, axis=1)
    near, angle = near[rows, order], angle[rows, order]
    turns = np.rad2deg(np.diff(np.concatenate([angle, angle[:, :1] + 2 * np.pi], axis=1), axis=1))
    uneven = length.max(axis=1) / length.min(axis=1)
    crooked = np.abs(turns - 90.0).max(axis=1)
    good = np.flatnonzero((uneven < EVEN) & (crooked < SQUARE))
    good = good[np.argsort(uneven[good] + crooked[good] / 90.0)]
    return good, near[good]


def _grow(grey: Grey, discs: Discs, tree: cKDTree, grown: _Grown) -> _Grown:
    """``grown`` with every disc that can be reached from it, without those that break it."""
    banned: set[tuple[int, int]] = set()
    for _ in range(MOST_REPAIRS):
        while True:
            larger = _ring(grey, discs, tree, grown, banned)
            if len(larger.lattice) == len(grown.lattice):
                break
            grown = larger
        kept = grown.even()
        if kept.all() or len(grown.lattice) < FEWEST:
            break
        banned |= {(int(i), int(j)) for i, j in grown.lattice.index[~kept]}
        grown = grown.select(kept)
    return grown


def _ring(grey: Grey, discs: Discs, tree: cKDTree, grown: _Grown, banned: set[tuple[int, int]]) -> _Grown:
    """``grown`` with the discs found one step, or else two steps, beyond its own."""
    known = grown.lattice
    for reach in (1, 2):
        beyond = frontier(known.index, reach, banned)
        if not len(beyond):
            continue
        expected = predict(known.index, known.uv, beyond)
        near = np.maximum(gate(expected), REACH * expected.spacing)
        distance, candidate = tree.query(expected.uv)
        seen = (distance < near)[:, None]
        diameter = np.median(grown.diameters())
        axes = np.where(seen[:, :, None], discs.axes[candidate], _positive(expected.jacobian) * diameter / 2.0)
        fitted = fit_discs(grey, np.where(seen, discs.uv[candidate], expected.uv), axes)
        steps, nearest = cKDTree(known.index).query(beyond)
        arms = _radii_between(grown.discs.select(nearest), fitted) / steps
        contrast = np.median(grown.discs.light - grown.discs.dark)
        miss = np.linalg.norm(fitted.uv - expected.uv, axis=1)
        found = fitted.sound & (miss < near) & (fitted.light - fitted.dark > PALE * contrast)
        found &= np.abs(np.log(np.maximum(arms, 1e-6) / grown.usual_arm())) < np.log(EVEN)
        found &= ~_holds(fitted, known.uv) & _nearest_of_each(fitted, miss)
        if found.any():
            return _Grown(known.joined(beyond[found], fitted.uv[found]), _joined(grown.discs, fitted.select(found)))
    return grown


def _positive(jacobian: Floats) -> Floats:
    """Axes of positive determinant that span the same ellipses."""
    return np.asarray(jacobian * np.where(np.linalg.det(jacobian) < 0, -1.0, 1.0)[:, None, None] ** [[0, 1]])


def _holds(discs: Discs, uv: Floats) -> Bools:
    """Which discs (n,) hold one of the points ``uv`` (m, 2)."""
    offset = uv[None] - discs.uv[:, None]
    inside = np.linalg.norm(np.linalg.solve(discs.axes, offset.transpose(0, 2, 1)), axis=1) < 1.0
    return np.asarray(inside.any(axis=1))


def _nearest_of_each(discs: Discs, miss: Floats) -> Bools:
    """Of discs that were found from several places, ``miss`` (n,) px from these, only the nearest to its place."""
    kept = np.zeros(len(discs), dtype=bool)
    for k in np.argsort(miss):
        kept[k] = not _holds(discs.select(np.array([k])), discs.uv[kept]).any()
    return kept


def _joined(a: Discs, b: Discs) -> Discs:
    return Discs(*(np.concatenate([getattr(a, n), getattr(b, n)]) for n in Discs.__dataclass_fields__))


# --- placement --------------------------------------------------------------------------------------


def _placed(grey: Grey, grown: _Grown, board: CircleGrid, *, name: str, mirrored: bool) -> Corners:
    """The discs of ``grown`` with their ids on ``board``; without discs and with a reason where it is another grid."""
    if other := _other_kind(grown, board):
        return not_found(name, f"the circles stand as on {other}, not as on {board.spec}")
    points, whole = _on_sheet(grown.lattice.index, board), np.rint(lattice(board)).astype(np.int64)
    ways = _ways(points, whole, mirrored=mirrored)
    if not ways:
        return not_found(name, f"a grid of {len(points)} circles {LARGER} {board.spec}, or is another")
    unit = np.sqrt(0.5) if board.asymmetric else 1.0
    seen = float(np.median(grown.diameters())) / unit
    if abs(seen / board.diameter - 1.0) > DIAMETER_MISMATCH:
        right = f"circles:{board.columns}x{board.rows}{':asymmetric' * board.asymmetric}:{seen:.2f}"
        return not_found(
            name, f"the circles measure {seen:.2f} of their spacing, not {board.diameter:g}: say {right} if they are so"
        )
    if len(points) < min(FEWEST_OF_PART, len(whole)):
        return not_found(name, f"only {len(points)} circles of a grid were found")
    symmetries = len(_ways(whole, whole, mirrored=False))
    if len(ways) > symmetries:
        blanks = [_blanks(grey, grown, way, board) for way in ways]
        ways = [way for way, blank in zip(ways, blanks, strict=True) if blank == min(blanks) <= 0.1 * len(points)]
    ambiguous = len(ways) > symmetries
    if not ways or (ambiguous and 2 * len(points) < len(whole)):
        return not_found(
            name, f"only {len(points)} of {len(whole)} circles are seen, and which ones cannot be told"
        )
    chosen = _nearest_top_left(ways, grown.lattice.uv)
    ids = _ids(chosen, board)
    order = np.argsort(ids)
    weights = FLOOR / np.hypot(FLOOR, grown.discs.std)
    assumed = ambiguous or not board.orientable
    return Corners(name, ids[order], grown.lattice.uv[order], weights[order], "", assumed, ambiguous)


def _other_kind(grown: _Grown, board: CircleGrid) -> str:
    """The whole grid that ``grown`` is if rows are offset where those of ``board`` are not, or the other way; or ""."""
    other = replace(board, columns=3, rows=3, asymmetric=not board.asymmetric, diameter=0.5)
    points = _on_sheet(grown.lattice.index, other)
    width, height = (np.ptp(points, axis=0) + 1).tolist()
    for across, rows in ((width, height), (height, width)):
        columns = across // 2 if other.asymmetric else across
        if min(columns, rows) >= 3 and columns * rows == len(points):
            other = replace(other, columns=columns, rows=rows)
            if _ways(points, np.rint(lattice(other)).astype(np.int64), mirrored=False):
                return other.spec
    return ""


def _on_sheet(index: Ints, board: CircleGrid) -> Ints:
    """Indices (n, 2) of a lattice of nearest neighbours as lattice coordinates of ``board``, up to turns and shifts."""
    return index @ np.array([[1, 1], [-1, 1]]) if board.asymmetric else index


def _ways(points: Ints, whole: Ints, *, mirrored: bool) -> list[Ints]:
    """The ways to lay ``points`` (n, 2) on the points ``whole`` of a board by quarter turns and shifts: (n, 2) each.

    Of the shifts of one turn the smallest comes first.
    """
    board = {(int(x), int(y)) for x, y in whole}
    room = whole.max(axis=0)
    turned = points * np.array([-1, 1]) if mirrored else points
    ways = []
    for _ in range(4):
        turned = np.stack([turned[:, 1], -turned[:, 0]], axis=1)
        first = turned - turned.min(axis=0)
        free = room - first.max(axis=0)
        shifts = [(x, y) for y in range(int(free[1]) + 1) for x in range(int(free[0]) + 1)]
        placed = [first + np.array(shift) for shift in shifts]
        ways += [way for way in placed if board.issuperset(map(tuple, way.tolist()))]
    return ways


def _blanks(grey: Grey, grown: _Grown, way: Ints, board: CircleGrid) -> int:
    """How many discs of ``board``, were ``way`` right, would cover what the image shows to be bare sheet."""
    whole = np.rint(lattice(board)).astype(np.int64)
    known = {(int(x), int(y)) for x, y in way}
    absent = np.array([p for p in whole.tolist() if tuple(p) not in known]).reshape(-1, 2)
    apart = np.abs(absent[:, None] - way[None]).max(axis=2).min(axis=1, initial=99)
    absent = absent[apart <= 2]
    if not len(absent):
        return 0
    expected = predict(way, grown.lattice.uv, absent)
    inner = 0.3 * board.diameter * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    places = expected.uv[:, None] + inner @ expected.jacobian.transpose(0, 2, 1)
    inside = ((places > 1) & (places < np.array([grey.shape[1], grey.shape[0]]) - 2)).all(axis=(1, 2))
    nearest = cKDTree(grown.lattice.uv).query(expected.uv)[1]
    light, dark = grown.discs.light[nearest], grown.discs.dark[nearest]
    brightest = sample(grey, places).max(axis=1)
    return int((inside & (light - brightest < PALE * (light - dark))).sum())


def _nearest_top_left(ways: list[Ints], uv: Floats) -> Ints:
    """The way whose point (0, 0) is nearest to the image's top left."""
    origin = np.zeros((1, 2))
    return min(ways, key=lambda way: float(np.linalg.norm(predict(way, uv, origin).uv)))


def _ids(points: Ints, board: CircleGrid) -> Ints:
    column = points[:, 0] // 2 if board.asymmetric else points[:, 0]
    return np.asarray(points[:, 1] * board.columns + column)
