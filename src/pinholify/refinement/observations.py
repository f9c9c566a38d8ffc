"""The data of the joint solve: all corners of all boards in flat arrays, sorted by board, and the image coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import Board, outline
from pinholify.corners import Corners

THINNED_CORNERS = 1200  # enough to bring a solve close to its end
THINNED_CORNERS_PER_BOARD = 16  # at least, of a board that has as many
MANY_BOARDS = 5  # as many are needed to separate errors that all boards share from those of each


@dataclass(frozen=True, slots=True, eq=False)
class ImageFrame:
    """Normalised image coordinates: x = (uv − ``centre``)/``scale``, with u reversed if the image is ``mirrored``.

    ``scale`` is half the image's diagonal in px, so that its corners lie on the unit circle. ``half_size`` (2,) is half
    its width and height in these units.
    """

    centre: Floats
    scale: float
    mirrored: bool
    half_size: Floats

    @property
    def signs(self) -> Floats:
        """The signs (2,) of the axes: −1 for one that is reversed."""
        return np.array([-1.0 if self.mirrored else 1.0, 1.0])

    def normalise(self, uv: Floats) -> Floats:
        """Normalised coordinates (n, 2) of pixels ``uv`` (n, 2)."""
        return (uv - self.centre) / self.scale * self.signs

    def restore(self, x: Floats) -> Floats:
        """Pixels (n, 2) of normalised coordinates ``x`` (n, 2)."""
        return x * self.signs * self.scale + self.centre


def image_frame(image_size: tuple[int, int], mirrored: bool) -> ImageFrame:
    """The normalised coordinates of images of ``image_size`` (width, height) px."""
    half = np.array(image_size) / 2.0
    scale = float(np.linalg.norm(half))
    return ImageFrame(half - 0.5, scale, mirrored, half / scale)


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """N corners of K boards, sorted by board.

    ``image`` (N, 2) are normalised image coordinates, ``lattice`` (N, 2) squares from the board's middle, ``corner``
    (N,) the corners' ids. ``placed`` (N,) is False where a view shows a part of the board of unknown offset, so that
    ids are relative. ``row`` (N,) is how far below the board's middle a corner lies in the image (normalised), and so
    how much later a rolling shutter reads it. ``weight`` (N,) multiplies a residual. ``view`` (N,) is the board's
    index, ``starts`` (K,) its first corner, ``names`` (K,) are the names of the views.
    """

    image: Floats
    lattice: Floats
    corner: Ints
    placed: Bools
    row: Floats
    weight: Floats
    view: Ints
    starts: Ints
    names: tuple[str, ...]

    @property
    def boards(self) -> int:
        """The number of boards K."""
        return len(self.names)

    def sums(self, values: Floats) -> Floats:
        """Sums over each board of ``values`` (N, …): (K, …)."""
        return np.asarray(np.add.reduceat(values, self.starts, axis=0))

    def slices(self) -> list[slice]:
        """The corners of each board, as K slices."""
        ends = np.append(self.starts[1:], len(self.view))
        return [slice(int(a), int(b)) for a, b in zip(self.starts, ends, strict=True)]

    def select(self, keep: Bools) -> Observations:
        """The corners where ``keep`` (N,) is True; boards without any of them are left out."""
        kept, starts, view = np.unique(self.view[keep], return_index=True, return_inverse=True)
        names = tuple(self.names[k] for k in kept)
        return replace(
            self,
            image=self.image[keep],
            lattice=self.lattice[keep],
            corner=self.corner[keep],
            placed=self.placed[keep],
            row=self.row[keep],
            weight=self.weight[keep],
            view=view,
            starts=starts,
            names=names,
        )

    def weighted(self, factors: Floats) -> Observations:
        """The same corners with the weights of each board multiplied by its entry of ``factors`` (K,)."""
        return replace(self, weight=self.weight * factors[self.view])

    def thinned(self) -> Observations:
        """A random part of each board's corners, about :data:`THINNED_CORNERS` in total: a faster, rougher solve."""
        share = min(1.0, THINNED_CORNERS / len(self.view))
        rng = np.random.default_rng(0)
        sizes = [rows.stop - rows.start for rows in self.slices()]
        drawn = [rng.permutation(size) < max(THINNED_CORNERS_PER_BOARD, share * size) for size in sizes]
        return self.select(np.concatenate(drawn))


def lattice_middle(board: Board) -> Floats:
    """The middle (2,) of the lattice, in squares."""
    first, last = outline(board)
    return (first + last) / 2.0


def observations(views: Sequence[Corners], board: Board, frame: ImageFrame) -> Observations:
    """All corners of ``views``, which have at least one each, on ``board``, in the coordinates of ``frame``."""
    sizes = np.array([len(view) for view in views])
    image = [frame.normalise(view.uv) for view in views]
    return Observations(
        np.concatenate(image),
        np.concatenate([view.lattice(board) for view in views]) - lattice_middle(board),
        np.concatenate([view.ids for view in views]),
        np.repeat([not view.ambiguous_offset for view in views], sizes),
        np.concatenate([each[:, 1] - each[:, 1].mean() for each in image]),
        np.concatenate([view.weights for view in views]),
        np.repeat(np.arange(len(views)), sizes),
        np.concatenate([[0], np.cumsum(sizes)[:-1]]),
        tuple(view.name for view in views),
    )
