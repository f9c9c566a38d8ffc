"""The model that the calibration chose, and the shape of the board that it found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.calibration.result import Calibration
from pinholify.evaluation.summary import Evaluation
from pinholify.gp.maps import AdditiveMap, DisplacementMap


@dataclass(frozen=True, slots=True)
class Process:
    """A Gaussian process ``of`` a quantity: its standard deviation in ``unit`` and its length scales in px."""

    of: str
    std: float
    unit: str
    length_scales_px: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Model:
    """Method, kernel, trend and hyperparameters; ``processes`` is empty if the evidence switched the process off.

    ``candidates`` are the trends that were tried, best first, with the deficit of their log evidence. ``bow``
    (squares), ``stretch`` and ``shear`` (fractions) and ``warp`` (squares, RMS) describe how the board differs from a
    flat lattice of squares; None if the data prefer one that does not. ``motion_px`` is the RMS motion of boards during
    the rolling shutter. ``singular_values`` are those of the closed-form solve.
    """

    method: str
    kernel: str
    trend: str
    noise_px: float
    processes: tuple[Process, ...]
    candidates: tuple[tuple[str, float], ...]
    bow: float | None
    stretch: float | None
    shear: float | None
    warp: float | None
    motion_px: float | None
    square_mm: float | None
    singular_values: tuple[float, ...]


def model_of(evaluation: Evaluation) -> Model:
    """The model of the evaluated camera."""
    calibration = evaluation.calibration
    found = calibration.findings
    ordered = sorted(found.log_evidence.items(), key=lambda pair: -pair[1])
    return Model(
        calibration.method,
        calibration.kernel,
        calibration.trend,
        calibration.camera.noise_px,
        _processes(calibration),
        tuple((name, ordered[0][1] - value) for name, value in ordered),
        found.board_bow_squares,
        found.board_stretch,
        found.board_shear,
        found.board_warp_squares,
        found.motion_px or None,
        calibration.square_mm,
        found.singular_values,
    )


def _processes(calibration: Calibration) -> tuple[Process, ...]:
    plane_map, kernel_px = calibration.camera.plane_map, calibration.findings.kernel_px
    if kernel_px:
        return (Process("displacement in the image", kernel_px[0], "px", kernel_px[1:]),)
    if isinstance(plane_map, DisplacementMap):
        kernel, px = plane_map.process.kernel, float(np.mean(plane_map.inputs.scale))
        scales = tuple(float(s) * px for s in kernel.length_scale)
        return (Process("displacement in the image", kernel.std * px, "px", scales),)
    if isinstance(plane_map, AdditiveMap):
        px, squares = float(np.mean(plane_map.inputs.scale)), float(np.mean(plane_map.outputs.scale))
        kernels = [process.kernel for process in plane_map.processes]
        return tuple(
            Process(f"virtual {axis}", k.std * squares, "squares", tuple(float(s) * px for s in k.length_scale))
            for axis, k in zip("xy", kernels, strict=True)
        )
    return ()
