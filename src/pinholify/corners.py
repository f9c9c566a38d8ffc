"""Corners found in images: the data every calibration starts from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from pinholify.arrays import Bools, Floats, Ints, frozen
from pinholify.board import Board, lattice_points, size
from pinholify.errors import InputError

SAME = "it has the same corners as"
"""Why a view that repeats another does not count; the other's name follows."""

SAME_PLACE_PX = 1.0
"""Two detections of one corner in one photograph differ by less; corners of two photographs rarely do."""


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """The corners of one board found in one image; none (and a ``reason``) where no board was found.

    ``ids`` (n,) int64 are lattice ids of the board, each at most once. ``uv`` (n, 2) float64 are their positions in px
    of the original image (integer = pixel centre). ``weights`` (n,) float64, all 1 by default, multiply a corner's
    residual: the standard deviation of a corner of weight ½ is taken to be twice that of one of weight 1. One number
    given in their place becomes the weight of every corner.

    ``orientation_assumed``: a half turn of the board would look the same. ``ambiguous_offset``: the visible part of the
    board may belong elsewhere on it. ``larger_board``: no board was found because the image shows a larger one.

    Raises ValueError for arrays whose shapes do not match, ids that are negative or repeated, and pixels or weights
    that are not finite.
    """

    name: str
    ids: Ints
    uv: Floats
    weights: Floats = field(default_factory=lambda: np.array(1.0))
    reason: str = ""
    orientation_assumed: bool = False
    ambiguous_offset: bool = False
    larger_board: bool = False

    def __post_init__(self) -> None:
        ids = frozen(self.ids, (None,), np.int64)
        if len(np.unique(ids)) != len(ids) or (len(ids) and ids.min() < 0):
            raise ValueError(f"corner ids of '{self.name}' are negative or appear twice")
        weights = frozen(np.full(len(ids), self.weights) if np.ndim(self.weights) == 0 else self.weights, (len(ids),))
        uv = frozen(self.uv, (len(ids), 2))
        if not (np.isfinite(uv).all() and np.isfinite(weights).all()):
            raise ValueError(f"corners of '{self.name}', or their weights, are not finite")
        object.__setattr__(self, "ids", ids)
        object.__setattr__(self, "uv", uv)
        object.__setattr__(self, "weights", weights)

    def __repr__(self) -> str:
        """The name, and the number of corners or the reason why there are none."""
        return f"<{self.name}: {len(self)} corners>" if self.found else f"<{self.name}: {self.reason or 'no board'}>"

    @property
    def found(self) -> bool:
        """Whether the image shows a board."""
        return len(self.ids) > 0

    def __len__(self) -> int:
        """Number of corners."""
        return len(self.ids)

    def lattice(self, board: Board) -> Floats:
        """Lattice coordinates (n, 2) of these corners on ``board``, in squares."""
        return lattice_points(board, self.ids)

    def select(self, keep: ArrayLike) -> Corners:
        """The corners where ``keep`` (n,) bool is true, everything else unchanged."""
        mask = np.asarray(keep, dtype=bool)
        return replace(self, ids=self.ids[mask], uv=self.uv[mask], weights=self.weights[mask])


def sorted_by_id(corners: Corners) -> Corners:
    """``corners`` in the order of their ids."""
    order = np.argsort(corners.ids)
    return replace(corners, ids=corners.ids[order], uv=corners.uv[order], weights=corners.weights[order])


def not_found(name: str, reason: str, *, larger_board: bool = False) -> Corners:
    """The result for image ``name``, in which no board was found for this ``reason``."""
    return Corners(name, np.empty(0, np.int64), np.empty((0, 2)), reason=reason, larger_board=larger_board)


def repeated(views: Iterable[Corners]) -> dict[str, str]:
    """Names of the views that repeat the corners of an earlier view, each with the name of that view.

    A photograph given twice, or a frozen video frame, has the same ids at the same pixels to 1e-6 px. It adds no
    information, not even about the noise.
    """
    first: dict[tuple[bytes, bytes], str] = {}
    repeats = {}
    for view in views:
        order = np.argsort(view.ids)
        key = view.ids[order].tobytes(), (view.uv[order].round(6) + 0.0).tobytes()  # no negative zeros
        if view.found and first.setdefault(key, view.name) != view.name:
            repeats[view.name] = first[key]
    return repeats


def in_common(view: Corners, other: Corners) -> Bools:
    """Mask (n,) of the corners of ``view`` that ``other`` has too, by id, less than ``SAME_PLACE_PX`` away."""
    _, mine, theirs = np.intersect1d(view.ids, other.ids, assume_unique=True, return_indices=True)
    common = np.zeros(len(view), dtype=bool)
    common[mine] = np.linalg.norm(view.uv[mine] - other.uv[theirs], axis=1) < SAME_PLACE_PX
    return common


def same_photograph(view: Corners, other: Corners) -> bool:
    """Whether both are corners of one photograph: of one file name, with most of the fewer corners in common.

    Folders in names do not matter, since names have only as many as make them unique. Corners may have been rounded in
    a table, fitted again or found with other settings; names alone may coincide, as those of two cameras' photographs.
    """
    alike = view.name.rsplit("/", 1)[-1] == other.name.rsplit("/", 1)[-1]
    return bool(alike and 2 * in_common(view, other).sum() > min(len(view), len(other)))


MAX_OUTSIDE_PX = 1.0
"""How far outside the centres of the outermost pixels a corner may lie."""

MAX_OUTSIDE_SHARE = 0.02
"""Of all corners: more of them outside belong to an image of another size, fewer are wrong corners."""


@dataclass(frozen=True, slots=True, eq=False)
class CornerSet:
    """All views of one board by one camera.

    ``image_size`` is (width, height) in px. ``centred`` applies to circle grids: the corners are the images of the
    discs' centres rather than the centroids of the discs' images. Raises InputError for ids that the board does not
    have and for two views of the same name.
    """

    board: Board
    image_size: tuple[int, int]
    views: tuple[Corners, ...] = field(default=())
    centred: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "views", tuple(self.views))
        names: set[str] = set()
        for view in self.views:
            if len(view) and int(view.ids.max()) >= size(self.board):
                raise InputError(
                    f"'{view.name}' has a corner of id {int(view.ids.max())}, but a {self.board.spec} board has only "
                    f"{size(self.board)} corners: give the size of the board in the images"
                )
            if view.name in names:
                raise InputError(f"two images are called '{view.name}': names must differ")
            names.add(view.name)

    def __repr__(self) -> str:
        """The board, and the numbers of images and corners."""
        width, height = self.image_size
        count = sum(map(len, self.views))
        return (
            f"<{self.board.spec} boards in {len(self.found)} of {len(self.views)} images of {width}x{height}, "
            f"{count} corners>"
        )

    @property
    def found(self) -> tuple[Corners, ...]:
        """The views that show a board."""
        return tuple(view for view in self.views if view.found)

    @property
    def outside(self) -> str:
        """Which corner lies outside the image, as the first clause of an error; empty where hardly any does."""
        width, height = self.image_size
        beyond = [
            np.maximum(-view.uv, view.uv - [width - 1, height - 1]).max(axis=1, initial=0.0) > MAX_OUTSIDE_PX
            for view in self.views
        ]
        if sum(map(np.sum, beyond)) <= MAX_OUTSIDE_SHARE * sum(map(len, beyond)):
            return ""
        view, first = next((v, v.uv[far][0]) for v, far in zip(self.views, beyond, strict=True) if far.any())
        return f"'{view.name}' has a corner at ({first[0]:.1f}, {first[1]:.1f}), outside an image of {width}x{height}"

    @property
    def typical_weight(self) -> float:
        """The median of the corners' weights; 1 where that is not positive, or where there are no corners."""
        weights = np.concatenate([view.weights for view in self.views]) if self.found else np.ones(1)
        return float(np.median(weights)) if np.median(weights) > 0.0 else 1.0

    @property
    def typically_weighted(self) -> CornerSet:
        """The same corners with their weights divided by the typical one, since only the ratios of weights matter."""
        typical = self.typical_weight
        return self.with_views(replace(view, weights=view.weights / typical) for view in self.views)

    def with_views(self, views: Iterable[Corners]) -> CornerSet:
        """The same board and image size with other ``views``."""
        return replace(self, views=tuple(views))
