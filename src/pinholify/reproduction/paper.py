"""The numbers that the paper reports: its Tables 1 and 2, as printed."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Reported:
    """A row of the paper's tables.

    ``ce`` is unitless; ``re`` and ``matlab_re`` are printed without a unit and agree with ``ce`` only when read as per
    cent of the board's corner spacing.
    """

    boards: int
    corners: str
    size: tuple[int, int]
    ce: float
    re: float
    matlab_re: float


REPORTED: dict[str, Reported] = {
    "unity-pinhole": Reported(30, "15x9", (3840, 2160), 0.954e-4, 0.1197, 0.1229),
    "unity-barrel": Reported(30, "15x9", (3840, 2160), 1.334e-4, 0.1410, 1.0315),
    "unity-pincushion": Reported(30, "15x9", (3840, 2160), 1.062e-4, 0.1243, 0.3879),
    "webcam": Reported(11, "15x9", (2560, 1440), 3.077e-4, 0.2478, 0.2666),
    "webcam-telelens": Reported(17, "14x9", (2560, 1440), 3.903e-4, 0.2576, 0.2667),
    "mirror": Reported(26, "14x9", (971, 871), 9.455e-4, 0.4404, 0.5376),
}
"""By the names in :data:`pinholify.simulation.datasets.DATASETS`, in the paper's order."""
