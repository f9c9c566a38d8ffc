"""Circle grids: discs grown into a lattice like a checkerboard's corners, and placed on the board.

Each disc's outline gives the local foreshortening of the sheet. In that frame the four nearest neighbours form a
cross, which seeds a lattice at any slant; an asymmetric grid's lattice is rotated by 45°. From there the Gaussian
process predicts each next disc, and the disc found there is fitted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pinholify.arrays import Bools, Floats, Ints, joined
from pinholify.board import CircleGrid, lattice
from pinholify.corners import Corners, not_found, sorted_by_id
from pinholify.detection.discs import Discs, find_discs, fit_discs
from pinholify.detection.growth import MAX_REPAIRS, MIN_LATTICE_CORNERS, SIDES, frontier, gate
from pinholify.detection.intensity import Grey, grey_levels, halvings, reduced
from pinholify.detection.lattice import Lattice
from pinholify.detection.placement import MIN_CORNERS_OF_PART
from pinholify.detection.prediction import local_frames, predict
from pinholify.detection.refine import STD_FLOOR_PX
from pinholify.detection.saddle import sample

FIRST_SIDE = 2000
"""The search starts on an image reduced by powers of two to at most this width and height (px)."""

MAX_SEEDS = 40
NEIGHBOURS = 8

CROSS_TOLERANCE_DEG = 30.0
"""How far the angles between the arms of a seed's cross may differ from 90°, in the frame of its disc."""

REACH = 0.75
"""How far the nearest disc may be from its prediction, as a fraction of the spacing."""

EVENNESS = 1.25
"""Largest ratio between the distance of two neighbours, in radii, and the median one."""

DIAMETER_MISMATCH = 0.15
"""Share by which the discs' diameter may differ from the board's, which the correction of their centres relies on."""

ROUGH_RATIO = 3.0
"""A disc whose standard deviation exceeds the median by this factor is taken to be partly covered."""

PALE_SHARE = 0.25
"""Share of the contrast by which a place must be darker than the sheet to hold a disc."""


def detect_circles(image: NDArray[Any], board: CircleGrid, *, name: str, mirrored: bool) -> Corners:
    """The centroids of the discs of ``board`` in ``image``.

    Arguments and result are those of :func:`pinholify.detection.detect_board`.
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
    """The discs in ``grey``, found in a reduced image first where it is large, and then at full size."""
    level = halvings(grey, FIRST_SIDE)
    if level > 0:
        discs, factor = find_discs(reduced(grey, level)), 2**level
        larger = fit_discs(grey, (discs.uv + 0.5) * factor - 0.5, discs.axes * factor)
        yield larger.select(larger.sound)
    yield find_discs(grey)


# --- growth -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Grown:
    """A lattice and the discs at its points, in the same order."""

    lattice: Lattice
    discs: Discs

    def select(self, keep: Bools) -> _Grown:
        return _Grown(self.lattice.select(keep), self.discs.select(keep))

    def diameters(self) -> Floats:
        """Diameters (n,) in steps of the lattice."""
        jacobian, _ = local_frames(self.lattice.index, self.lattice.uv)
        return np.asarray(2.0 * np.sqrt(self.discs.areas / np.abs(np.linalg.det(jacobian))))

    def usual_arm(self) -> float:
        """Median distance of neighbours, in radii."""
        return float(np.median(self._arms()[2]))

    def even(self) -> Bools:
        """Which discs (n,) are at the usual distance from most of their neighbours."""
        first, second, arms = self._arms()
        fits = np.abs(np.log(arms / np.median(arms))) < np.log(EVENNESS)
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
    """Distances (n,) in radii between the discs of each pair, averaged over both discs' foreshortenings."""
    offset = (b.uv - a.uv)[:, :, None]
    lengths = [np.linalg.norm(np.linalg.solve(discs.axes, offset)[:, :, 0], axis=1) for discs in (a, b)]
    return np.asarray(np.mean(lengths, axis=0))


def _lattices(grey: Grey, discs: Discs) -> Iterator[_Grown]:
    """Lattices of at least MIN_LATTICE_CORNERS discs, the most regular seed first; no disc is used twice."""
    if len(discs) < MIN_LATTICE_CORNERS:
        return
    tree = cKDTree(discs.uv)
    free = np.ones(len(discs), dtype=bool)
    seeds, crosses = _seeds(discs, tree)
    for seed, cross in list(zip(seeds.tolist(), crosses, strict=True))[:MAX_SEEDS]:
        if not free[seed]:
            continue
        start = np.array([seed, *cross])
        index = np.concatenate([[[0, 0]], SIDES])
        grown = _grow(grey, discs, tree, _Grown(_plain(index, discs.uv[start]), discs.select(start)))
        used = tree.query_ball_point(grown.lattice.uv, 2.0)
        free[[i for group in used for i in group]] = False
        if len(grown.lattice) >= MIN_LATTICE_CORNERS:
            yield _fitted(grey, grown)


def _fitted(grey: Grey, grown: _Grown) -> _Grown:
    """``grown`` with each disc fitted once more from where it was found, without partly covered discs.

    The edge of a finger makes an outline rougher than the others.
    """
    discs = fit_discs(grey, grown.discs.uv, grown.discs.axes)
    fitted = _Grown(grown.lattice.moved(discs.uv), discs)
    rough = discs.std > ROUGH_RATIO * np.median(discs.std) + STD_FLOOR_PX
    return fitted.select(discs.sound & ~rough)


def _plain(index: Ints, uv: Floats) -> Lattice:
    return Lattice(index, uv, np.ones(len(index)), 1)


def _seeds(discs: Discs, tree: cKDTree) -> tuple[Ints, Ints]:
    """Discs (m,) whose four nearest neighbours form a cross, and these neighbours (m, 4), clockwise; best first."""
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
    good = np.flatnonzero((uneven < EVENNESS) & (crooked < CROSS_TOLERANCE_DEG))
    good = good[np.argsort(uneven[good] + crooked[good] / 90.0)]
    return good, near[good]


def _grow(grey: Grey, discs: Discs, tree: cKDTree, grown: _Grown) -> _Grown:
    """``grown`` with every disc that can be reached from it, without irregular ones."""
    banned: set[tuple[int, int]] = set()
    for _ in range(MAX_REPAIRS):
        while True:
            larger = _ring(grey, discs, tree, grown, banned)
            if len(larger.lattice) == len(grown.lattice):
                break
            grown = larger
        kept = grown.even()
        if kept.all() or len(grown.lattice) < MIN_LATTICE_CORNERS:
            break
        banned |= {(int(i), int(j)) for i, j in grown.lattice.index[~kept]}
        grown = grown.select(kept)
    return grown


def _ring(grey: Grey, discs: Discs, tree: cKDTree, grown: _Grown, banned: set[tuple[int, int]]) -> _Grown:
    """``grown`` with the discs found one step, or failing that two steps, beyond it."""
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
        found = fitted.sound & (miss < near) & (fitted.light - fitted.dark > PALE_SHARE * contrast)
        found &= np.abs(np.log(np.maximum(arms, 1e-6) / grown.usual_arm())) < np.log(EVENNESS)
        found &= ~_holds(fitted, known.uv) & _nearest_of_each(fitted, miss)
        if found.any():
            return _Grown(known.joined(beyond[found], fitted.uv[found]), joined([grown.discs, fitted.select(found)]))
    return grown


def _positive(jacobian: Floats) -> Floats:
    """Axes (n, 2, 2) of positive determinant that span the same ellipses as ``jacobian`` (n, 2, 2)."""
    return np.asarray(jacobian * np.where(np.linalg.det(jacobian) < 0, -1.0, 1.0)[:, None, None] ** [[0, 1]])


def _holds(discs: Discs, uv: Floats) -> Bools:
    """Which discs (n,) contain one of the pixels ``uv`` (m, 2)."""
    offset = uv[None] - discs.uv[:, None]
    inside = np.linalg.norm(np.linalg.solve(discs.axes, offset.transpose(0, 2, 1)), axis=1) < 1.0
    return np.asarray(inside.any(axis=1))


def _nearest_of_each(discs: Discs, miss: Floats) -> Bools:
    """Which discs (n,) to keep where one was found from several predictions: the nearest, by ``miss`` (n,) px."""
    kept = np.zeros(len(discs), dtype=bool)
    for k in np.argsort(miss):
        kept[k] = not _holds(discs.select(np.array([k])), discs.uv[kept]).any()
    return kept


# --- placement --------------------------------------------------------------------------------------


def _placed(grey: Grey, grown: _Grown, board: CircleGrid, *, name: str, mirrored: bool) -> Corners:
    """The discs of ``grown`` with their ids on ``board``, or the reason why it is not that grid."""
    if other := _other_kind(grown, board):
        return not_found(name, f"the circles are arranged as on {other}, not as on {board.spec}")
    points, whole = _on_sheet(grown.lattice.index, board), np.rint(lattice(board)).astype(np.int64)
    ways = _ways(points, whole, mirrored=mirrored)
    if not ways:
        reason = f"a grid of {len(points)} circles is larger than {board.spec}, or is another"
        return not_found(name, reason, larger_board=True)
    unit = np.sqrt(0.5) if board.asymmetric else 1.0
    seen = float(np.median(grown.diameters())) / unit
    if abs(seen / board.diameter - 1.0) > DIAMETER_MISMATCH:
        right = f"circles:{board.columns}x{board.rows}{':asymmetric' * board.asymmetric}:{seen:.2f}"
        measured = f"the diameter of the circles is {seen:.2f} of their spacing, not {board.diameter:g}"
        return not_found(name, f"{measured}: give {right} if that is the board")
    if len(points) < min(MIN_CORNERS_OF_PART, len(whole)):
        return not_found(name, f"only {len(points)} circles of a grid were found")
    symmetries = len(_ways(whole, whole, mirrored=False))
    if len(ways) > symmetries:
        blanks = [_blanks(grey, grown, way, board) for way in ways]
        ways = [way for way, blank in zip(ways, blanks, strict=True) if blank == min(blanks) <= 0.1 * len(points)]
    ambiguous = len(ways) > symmetries
    if not ways or (ambiguous and 2 * len(points) < len(whole)):
        return not_found(
            name, f"only {len(points)} of {len(whole)} circles are visible, and which ones cannot be determined"
        )
    chosen = _nearest_top_left(ways, grown.lattice.uv)
    corners = Corners(
        name,
        _ids(chosen, board),
        grown.lattice.uv,
        STD_FLOOR_PX / np.hypot(STD_FLOOR_PX, grown.discs.std),
        orientation_assumed=ambiguous or not board.orientable,
        ambiguous_offset=ambiguous,
    )
    return sorted_by_id(corners)


def _other_kind(grown: _Grown, board: CircleGrid) -> str:
    """The complete grid that ``grown`` shows if it is asymmetric where ``board`` is not, or vice versa; else empty."""
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
    """Indices (n, 2) of nearest neighbours as lattice coordinates of ``board``, up to rotation and shift."""
    return index @ np.array([[1, 1], [-1, 1]]) if board.asymmetric else index


def _ways(points: Ints, whole: Ints, *, mirrored: bool) -> list[Ints]:
    """The placements (n, 2) of ``points`` (n, 2) on the points ``whole`` of a board, by quarter turns and shifts.

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
    """Number of discs that ``board`` would have, if ``way`` were right, where the image shows bare sheet."""
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
    return int((inside & (light - brightest < PALE_SHARE * (light - dark))).sum())


def _nearest_top_left(ways: list[Ints], uv: Floats) -> Ints:
    """The placement whose point (0, 0) is nearest to the image's top left corner."""
    origin = np.zeros((1, 2))
    return min(ways, key=lambda way: float(np.linalg.norm(predict(way, uv, origin).uv)))


def _ids(points: Ints, board: CircleGrid) -> Ints:
    column = points[:, 0] // 2 if board.asymmetric else points[:, 0]
    return np.asarray(points[:, 1] * board.columns + column)
