"""The joint refinement: one camera from all boards together, with the model chosen by evidence.

:func:`refine` is the entry point. Each corner is seen at w + g(w) + noise, where w is a parametric trend of its ray and
g a Gaussian process in the image, written as a sum of sines. Trend, process, all poses and the board's shape are solved
together. The package in reading order:

The model:

- ``joint``: the stages from corners to a camera; start reading here
- ``observations``: all corners in flat arrays, in normalised image coordinates
- ``trends``: parametric cameras between rays and the image (``base`` is the interface, ``radial`` lenses,
  ``polynomial`` anything smooth, ``fitting`` the fit of a trend to known rays)
- ``basis``: the sines that carry the process
- ``spectral``: the kernels' spectral densities, which are the sines' prior variances
- ``shape``: bend, stretch and warp of the board
- ``surface``: the smooth functions of a warp
- ``model``: all of these together: unknowns, prediction and derivatives

Its solution:

- ``normal``: normal equations with the poses eliminated
- ``solver``: Levenberg-Marquardt with a robust loss
- ``evidence``: the evidence of a linearised solve, and its hyperparameters

The stages:

- ``start``: a first camera from a scan of simple lenses, or from a given camera
- ``outliers``: tests that find wrong corners and boards
- ``candidates``: trends with and without process compared by evidence
- ``settle``: the winner solved in full, and the choice of the board's shape
- ``cleaning``: screening before the choice of the trend; full solves without wrong corners after it
- ``trust``: each board's own noise
- ``sharing``: errors that all views share, the sign of a warp
- ``warp``: how large a warp is
- ``motion``: how much boards moved while a rolling shutter read the image

The result:

- ``maps``: pixels to rays with their covariance
- ``disagreement``: error bars widened where boards disagree by more than noise
- ``result``: camera, poses, residuals and shape of the board
- ``diagnosis``: structure in residuals, suspicious boards, the next board
- ``comparison``: two cameras compared

Names are loaded on first use, so a saved camera maps pixels without loading the solver.
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
