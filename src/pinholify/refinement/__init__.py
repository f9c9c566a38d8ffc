"""The joint refinement: one camera from all boards together, with everything it needs chosen by evidence.

:func:`refine` is the way in. Each corner is seen at w + g(w) + noise, where w is a parametric trend of the
ray to it and g a Gaussian process in the image, carried by sines. Trend, process and all poses are solved
together.

Names are loaded when they are first used: a camera that was refined once maps pixels without the solver.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pinholify.refinement.comparison import Comparison, compare
    from pinholify.refinement.diagnosis import (
        BoardSuspicion,
        NextBoard,
        Structure,
        next_board,
        residual_structure,
        suspicious_boards,
    )
    from pinholify.refinement.joint import refine
    from pinholify.refinement.maps import JointMap
    from pinholify.refinement.result import JointResult, Shape

_HOMES = {
    "BoardSuspicion": "diagnosis",
    "Comparison": "comparison",
    "JointMap": "maps",
    "JointResult": "result",
    "NextBoard": "diagnosis",
    "Shape": "result",
    "Structure": "diagnosis",
    "compare": "comparison",
    "next_board": "diagnosis",
    "refine": "joint",
    "residual_structure": "diagnosis",
    "suspicious_boards": "diagnosis",
}

__all__ = [
    "BoardSuspicion",
    "Comparison",
    "JointMap",
    "JointResult",
    "NextBoard",
    "Shape",
    "Structure",
    "compare",
    "next_board",
    "refine",
    "residual_structure",
    "suspicious_boards",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'pinholify.refinement' has no attribute '{name}'")
    return getattr(importlib.import_module(f"pinholify.refinement.{_HOMES[name]}"), name)
