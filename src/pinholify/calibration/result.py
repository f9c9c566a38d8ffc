"""The finished calibration, by whichever method."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pinholify.arrays import Floats, frozen
from pinholify.board import Board
from pinholify.board import lattice as board_lattice
from pinholify.calibration.findings import Findings, findings_of
from pinholify.camera import VirtualCamera
from pinholify.charts import Intrinsics
from pinholify.corners import Corners, CornerSet, same_photograph

IMPORTED = "imported"
"""The method of a calibration imported from another program."""


@dataclass(frozen=True, slots=True, eq=False)
class Settings:
    """What was asked of a calibration, which :func:`pinholify.pipeline.recalibrate` asks of other corners.

    Fields are as the arguments of :func:`pinholify.calibrate`, but ``method`` is the one that ``auto`` chose.
    """

    method: str
    kernel: str
    trend: str
    mirrored: bool
    start: VirtualCamera | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A camera, the corners it was made from and how.

    ``method``, ``kernel`` and ``trend`` are those used, ``reference`` is the name of the view whose board fixes the
    frame. ``intrinsics_std`` (3,) are the standard deviations of f, uc, vc in squares, nan where unknown.
    ``closed_form`` is the paper's K, by the simplified Zhang's method alone; None for a method without one.
    ``square_mm`` is the side of a square where the user gave it. ``board_points`` (corners, 3) are the board's points
    by id, in squares: the flat lattice unless given, as by a method that found the board bent or stretched. ``details``
    are plain numbers and texts that JSON can hold; :attr:`findings` are the same with types. ``settings`` are what was
    asked for, None where that is unknown.
    """

    camera: VirtualCamera
    corner_set: CornerSet
    method: str
    kernel: str
    trend: str
    reference: str
    intrinsics_std: Floats
    square_mm: float | None = None
    closed_form: Intrinsics | None = None
    board_points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    details: dict[str, object] = field(default_factory=dict)
    settings: Settings | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "intrinsics_std", frozen(self.intrinsics_std, (3,)))
        points = self.board_points if len(self.board_points) else flat(board_lattice(self.corner_set.board))
        object.__setattr__(self, "board_points", frozen(points, (None, 3)))

    def __repr__(self) -> str:
        """A summary for a person: method, reference, f, uc, vc, noise and corners."""
        k, spread = self.camera.intrinsics, self.intrinsics_std
        lengths = ", ".join(
            f"{name} {value:.5g}" + (f" ± {std:.2g}" if np.isfinite(std) else "")
            for name, value, std in zip(("f", "uc", "vc"), (k.f, k.uc, k.vc), spread, strict=True)
        )
        noise = f", noise {self.camera.noise_px:.3f} px" if np.isfinite(self.camera.noise_px) else ""
        width, height = self.camera.image_size
        made_of = repr(self.corner_set) if self.corner_set.views else f"images of {width}x{height}"
        return f"<{self.method} calibration from '{self.reference}': {lengths} {self.unit}{noise}; {made_of}>"

    @property
    def unit(self) -> str:
        """The unit of f, uc, vc and the virtual plane: squares, or px for an imported camera's ideal image."""
        return "px" if self.method == IMPORTED else "squares"

    @property
    def findings(self) -> Findings:
        """What the method found besides the camera."""
        return findings_of(self.details)

    def known(self, view: Corners) -> Corners | None:
        """The corners of the same photograph that the camera was made from; None where it was not made from it."""
        return next((own for own in self.corner_set.found if same_photograph(view, own)), None)

    def points_of(self, board: Board) -> Floats:
        """The points (corners, 3) of ``board`` by id, in squares: as found, or flat if it is not the calibration's."""
        return self.board_points if board.spec == self.corner_set.board.spec else flat(board_lattice(board))


def flat(lattice: Floats) -> Floats:
    """Lattice points (n, 2) as solid ones (n, 3) with z = 0."""
    return np.concatenate([lattice, np.zeros((len(lattice), 1))], axis=1)
