"""Kalibr's camchain YAML (https://github.com/ethz-asl/kalibr/wiki/yaml-formats): camera and distortion models."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pinholify.arrays import Floats
from pinholify.io.importing import projections
from pinholify.io.importing.base import Foreign, ForeignCamera, Projection

CORE = 4


def cameras(foreign: Foreign) -> Mapping[str, ForeignCamera]:
    """All cameras of the chain by name (cam0, cam1, …)."""
    chain = {name: value for name, value in foreign.tree.items() if isinstance(value, dict) and "intrinsics" in value}
    if not chain:
        raise foreign.refused("it holds no camera with intrinsics")
    return {str(name): _camera(foreign, value) for name, value in chain.items()}


def _camera(foreign: Foreign, entry: Mapping[str, Any]) -> ForeignCamera:
    lens = f"{entry.get('camera_model')}-{entry.get('distortion_model') or 'none'}"
    if lens not in MODELS:
        raise foreign.refused(f"its model {lens} is not supported; supported are {', '.join(MODELS)}")
    own, count, make = MODELS[lens]
    numbers = foreign.numbers(entry["intrinsics"], "intrinsics", own + CORE)
    distortion = foreign.numbers(entry.get("distortion_coeffs") or [], "distortion coefficients", count)
    core, size = numbers[own:], foreign.size(entry.get("resolution"))
    return ForeignCamera(foreign.name, "Kalibr", lens, make(core, numbers[:own], distortion), core[:2], core[2:], size)


Make = Callable[[Floats, Floats, Floats], Projection]

MODELS: dict[str, tuple[int, int, Make]] = {
    "pinhole-none": (0, 0, lambda core, own, distortion: projections.brown(core, np.zeros(4))),
    "pinhole-radtan": (0, 4, lambda core, own, distortion: projections.brown(core, distortion)),
    "pinhole-equi": (0, 4, lambda core, own, distortion: projections.fisheye(core, distortion)),
    "pinhole-fov": (0, 1, lambda core, own, distortion: projections.field_of_view(core, float(distortion[0]))),
    "omni-none": (1, 0, lambda core, own, distortion: projections.unified(core, float(own[0]), np.zeros(4))),
    "omni-radtan": (1, 4, lambda core, own, distortion: projections.unified(core, float(own[0]), distortion)),
    "eucm-none": (2, 0, lambda core, own, distortion: projections.extended_unified(core, *map(float, own))),
    "ds-none": (2, 0, lambda core, own, distortion: projections.double_sphere(core, *map(float, own))),
}
"""Model → numbers of intrinsics before fx, fy, cx, cy and of distortion coefficients, and its projection."""
