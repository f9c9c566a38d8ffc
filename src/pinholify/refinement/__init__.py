"""The joint refinement: one camera from all boards together, with everything it needs chosen by evidence.

:func:`refine` is the way in. Each corner is seen at w + g(w) + noise, where w is a parametric trend of the
ray to it and g a Gaussian process in the image, carried by sines. Trend, process and all poses are solved
together.
"""

from pinholify.refinement.comparison import Comparison, compare
from pinholify.refinement.diagnosis import (
    BoardSuspicion,
    NextBoard,
    Structure,
    next_board,
    residual_structure,
    suspicious_boards,
)
from pinholify.refinement.maps import JointMap
from pinholify.refinement.refine import refine
from pinholify.refinement.result import JointResult, Shape

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
