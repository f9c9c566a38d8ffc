"""Simulated lenses, one per file, with a specimen of each in :data:`LENSES`.

A new lens is one new file and one line here; the conformance tests run over the registry.
"""

from __future__ import annotations

from pinholify.simulation.lenses.base import Lens, LensRays
from pinholify.simulation.lenses.brown_conrady import BrownConrady
from pinholify.simulation.lenses.fisheye import Fisheye
from pinholify.simulation.lenses.mirror import Mirror
from pinholify.simulation.lenses.pinhole import Pinhole
from pinholify.simulation.lenses.resized import Resized
from pinholify.simulation.lenses.unity import Unity
from pinholify.simulation.lenses.water import WaterPane
from pinholify.simulation.lenses.windscreen import Bump, Windscreen, bumpy

__all__ = [
    "LENSES",
    "BrownConrady",
    "Bump",
    "Fisheye",
    "Lens",
    "LensRays",
    "Mirror",
    "Pinhole",
    "Resized",
    "Unity",
    "WaterPane",
    "Windscreen",
    "bumpy",
]

_WIDE = Fisheye((1280, 960), 450.0, (0.02, -0.008, 0.001, 0.0), (6.0, -9.0))

LENSES: dict[str, Lens] = {
    "pinhole": Pinhole((1280, 960), 900.0, (4.0, -3.0)),
    "unity-barrel": Unity((1280, 720), 667.0, 55.0),
    "unity-pincushion": Unity((1280, 720), 667.0, -40.0, (-0.15, 0.15)),
    "brown-conrady": BrownConrady((1280, 960), (900.0, 905.0), (7.0, -4.0), radial=(-0.28, 0.11, -0.02),
                                  tangential=(0.0008, -0.0005)),
    "rational-prism-tilt": BrownConrady((1280, 960), (700.0, 702.0), (-5.0, 3.0), radial=(0.9, 0.14, 0.004),
                                        denominator=(1.2, 0.35, 0.02), tangential=(0.0006, 0.0004),
                                        thin_prism=(0.001, -0.0003, -0.0008, 0.0002), tilt=(0.02, -0.015)),
    "fisheye": _WIDE,
    "windscreen": bumpy(_WIDE, count=12, width=110.0, shift=6.0, seed=3),
    "water": WaterPane(Pinhole((1280, 960), 900.0), 0.8, 0.3, (0.05, -0.08, 1.0)),
    "mirror": Mirror(Pinhole((971, 871), 1100.0), 12.0, 0.01, 0.0003, 9.0, tilt=25.0),
    "fisheye-mirror": Mirror(_WIDE, 3.0, 0.02, 0.001, 9.0, tilt=20.0),
    "resized": Resized(Unity((3840, 2160), 2000.0, 55.0), (1280, 720)),
}
"""A specimen of every lens, by name."""
