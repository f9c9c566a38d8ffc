"""An evaluation as text for people and as JSON for programs."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

from pinholify.evaluation.summary import Evaluation


def to_json(evaluation: Evaluation) -> dict[str, Any]:
    """The object that ``--json`` prints; its keys are fixed."""
    calibration = evaluation.calibration
    k, refined = calibration.camera.intrinsics, calibration.refined
    f_std, uc_std, vc_std = (float(s) for s in calibration.intrinsics_std)
    return {
        "format_version": 1,
        "method": calibration.method,
        "kernel": calibration.kernel,
        "trend": calibration.trend,
        "f": k.f,
        "uc": k.uc,
        "vc": k.vc,
        "f_std": f_std,
        "uc_std": uc_std,
        "vc_std": vc_std,
        "refined": {"f": refined.f, "uc": refined.uc, "vc": refined.vc},
        "square_mm": calibration.square_mm,
        "reference": calibration.reference,
        "mirrored": calibration.camera.mirrored,
        "boards": [
            {
                "file": b.file,
                "used": b.used,
                "reason": b.reason,
                "corners": b.corners,
                "inside": b.inside,
                "ce": b.ce,
                "re_percent": b.re_percent,
                "re_refined_percent": b.re_refined_percent,
            }
            for b in evaluation.boards
        ],
        "ce": evaluation.pooled.ce,
        "re_percent": evaluation.pooled.re_percent,
        "re_refined_percent": evaluation.pooled.re_refined_percent,
        "re_px": evaluation.pooled.re_px,
        "without_reference": {
            "ce": evaluation.pooled_without_reference.ce,
            "re_percent": evaluation.pooled_without_reference.re_percent,
            "re_refined_percent": evaluation.pooled_without_reference.re_refined_percent,
            "re_px": evaluation.pooled_without_reference.re_px,
        },
        "pinholeness": evaluation.pinholeness,
        "noise_px": calibration.camera.noise_px,
        "heldout_px": evaluation.heldout_px,
        "heldout_kfold_px": evaluation.kfold_px,
        "opencv": {
            name: {"insample_px": s.insample_px, "re_percent": s.re_percent, "heldout_px": s.heldout_px}
            for name, s in evaluation.opencv.items()
        },
        "details": calibration.details,
    }


def print_evaluation(evaluation: Evaluation) -> None:
    """The evaluation for people, on standard output."""
    console = Console(highlight=False)
    calibration, pooled = evaluation.calibration, evaluation.pooled
    k, std = calibration.camera.intrinsics, calibration.intrinsics_std
    used = sum(b.used for b in evaluation.boards)
    found = sum(b.corners > 0 for b in evaluation.boards)
    console.print(
        f"[bold]{calibration.method}[/] camera from [bold]{calibration.reference}[/]: {used} of {found} boards count "
        f"({len(evaluation.boards)} images), trend {calibration.trend}, kernel {calibration.kernel}"
    )
    for name, value, error in zip(("f", "uc", "vc"), (k.f, k.uc, k.vc), std, strict=True):
        console.print(f"  {name:2s} = {value:.5f} ± {error:.5f} squares{_millimetres(value, calibration.square_mm)}")
    console.print(
        f"  corner noise {calibration.camera.noise_px:.3f} px   CE {pooled.ce * 1e4:.3f}e-4   "
        f"RE {pooled.re_percent:.3f} % closed form, {pooled.re_refined_percent:.3f} % refined "
        f"({pooled.re_px:.3f} px)" + _pinholeness(evaluation)
    )
    console.print(_comparison(evaluation))
    if evaluation.heldout_px is None and evaluation.heldout_reason:
        console.print(f"  no held-out error: {evaluation.heldout_reason}")
    for board in evaluation.boards:
        if not board.used:
            console.print(f"  [dim]{board.file} does not count: {board.reason}[/]", soft_wrap=True)


def _millimetres(squares: float, square_mm: float | None) -> str:
    return "" if square_mm is None else f"  ({squares * square_mm:.3f} mm)"


def _pinholeness(evaluation: Evaluation) -> str:
    return "" if evaluation.pinholeness is None else f"   pinholeness {evaluation.pinholeness:.2e} f"


def _comparison(evaluation: Evaluation) -> Table:
    """Held-out and in-sample errors, never in one column."""
    table = Table("model", "held out, px", "in sample, px", "RE in sample, %", box=None, pad_edge=True)
    table.add_row(
        f"pinholify {evaluation.calibration.method}",
        _number(evaluation.heldout_px),
        _number(evaluation.pooled.re_px),
        _number(evaluation.pooled.re_refined_percent),
        style="bold",
    )
    for name, score in evaluation.opencv.items():
        table.add_row(name, _number(score.heldout_px), _number(score.insample_px), _number(score.re_percent))
    return table


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
