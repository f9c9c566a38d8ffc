"""What the joint solve is given: all corners of all boards in flat arrays, sorted by board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats, Ints
from pinholify.board import Board, outline
from pinholify.corners import Corners

ENOUGH = 1200  # corners to lead a solve near its end
FEWEST = 16  # of a board, where it has as many
MANY_BOARDS = 5  # from which on what boards share can be told from what each does of its own


@dataclass(frozen=True, slots=True, eq=False)
class ImageFrame:
    """Normalised image coordinates: x = (uv − ``centre``)/``scale``, u reversed where the image is a
    reflection.

    ``half_size`` (2,) is the image's half width and height in these units; its corners lie on the unit
    circle.
    """

    centre: Floats
    scale: float
    mirrored: bool
    half_size: Floats

    @property
    def signs(self) -> Floats:
        """(2,): −1 for an axis that is reversed."""
        return np.array([-1.0 if self.mirrored else 1.0, 1.0])

    def normalise(self, uv: Floats) -> Floats:
        """px to normalised coordinates, (n, 2)."""
        return (uv - self.centre) / self.scale * self.signs

    def restore(self, x: Floats) -> Floats:
        """Normalised coordinates to px, (n, 2)."""
        return x * self.signs * self.scale + self.centre


def image_frame(image_size: tuple[int, int], mirrored: bool) -> ImageFrame:
    """The normalised coordinates of images of ``image_size`` (width, height) px."""
    half = np.array(image_size) / 2.0
    scale = float(np.linalg.norm(half))
    return ImageFrame(half - 0.5, scale, mirrored, half / scale)


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """N corners of K boards, sorted by board.

    ``image`` (N, 2) normalised image coordinates, ``lattice`` (N, 2) squares from the board's middle, ``corner`` (N,)
    the corner's id, ``placed`` (N,) whether the view tells which of all corners it is, and not only which beside the
    others of the view; ``row`` (N,) is how far below the board's middle it lies in the image, and so how much later it
    was read where the shutter rolls; ``weight`` (N,) multiplies a residual, ``view`` (N,) is the board's index,
    ``starts`` (K,) its first corner, ``names`` (K,).
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
        """K."""
        return len(self.names)

    def sums(self, values: Floats) -> Floats:
        """Sums over each board of ``values`` (N, …): (K, …)."""
        return np.asarray(np.add.reduceat(values, self.starts, axis=0))

    def slices(self) -> list[slice]:
        """Where each board's corners are."""
        ends = np.append(self.starts[1:], len(self.view))
        return [slice(int(a), int(b)) for a, b in zip(self.starts, ends, strict=True)]

    def select(self, keep: Bools) -> Observations:
        """The corners where ``keep`` (N,) is true; boards left without any vanish."""
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
        """The same with the weights of each board multiplied by its own of the ``factors`` (K,)."""
        return replace(self, weight=self.weight * factors[self.view])

    def thinned(self) -> Observations:
        """Some corners of all boards: they tell in a fraction of the time where all of them will lead."""
        share = min(1.0, ENOUGH / len(self.view))
        rng = np.random.default_rng(0)
        drawn = [rng.permutation(k.stop - k.start) < max(FEWEST, share * (k.stop - k.start)) for k in self.slices()]
        return self.select(np.concatenate(drawn))


def lattice_middle(board: Board) -> Floats:
    """The middle (2,) of the lattice, in squares."""
    first, last = outline(board)
    return (first + last) / 2.0


def observations(views: Sequence[Corners], board: Board, frame: ImageFrame) -> Observations:
    """All corners of ``views``, each of which has at least one."""
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
