"""A finished calibration, by whichever method."""

from __future__ import annotations

from dataclasses import dataclass, field

from pinholify.arrays import Floats, frozen
from pinholify.camera import VirtualCamera
from pinholify.charts import Intrinsics
from pinholify.corners import CornerSet


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A camera, the corners it was made from and how.

    ``intrinsics_std`` (3,) are the standard deviations of f, uc, vc in squares, nan where unknown. ``refined`` is K by
    least squares over all boards, reported beside the closed form of the one-image method. ``square_mm`` is the
    board's square where the user gave it. ``details`` are plain numbers and texts worth keeping (JSON-able).
    """

    camera: VirtualCamera
    corner_set: CornerSet
    method: str
    kernel: str
    trend: str
    reference: str
    intrinsics_std: Floats
    refined: Intrinsics
    square_mm: float | None = None
    details: dict[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "intrinsics_std", frozen(self.intrinsics_std, (3,)))
