"""An evaluation as text for people and as JSON for programs."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from pinholify.calibration.result import Calibration
from pinholify.evaluation.summary import Evaluation
from pinholify.evaluation.verdict import Verdict
from pinholify.evaluation.wrong_corners import sentences

if TYPE_CHECKING:  # slow to load, and --json prints no table
    from rich.table import Table

ASIDE_SHOWN = 8
WIDTH = 78
SHAPES = "pinholify is scored with the board's shape that it found, OpenCV's models with a flat board"


def _wrong(evaluation: Evaluation) -> dict[str, Any]:
    wrong = evaluation.wrong
    return {"count": wrong.count, "of": wrong.found, "share": wrong.share, "by_image": wrong.counts,
            "crowded": list(wrong.crowded)}


def to_json(evaluation: Evaluation, verdict: Verdict) -> dict[str, Any]:
    """The object that ``--json`` prints; its keys are fixed."""
    calibration = evaluation.calibration
    k, closed = calibration.camera.intrinsics, calibration.closed_form
    f_std, uc_std, vc_std = (float(s) for s in calibration.intrinsics_std)
    return {
        "format_version": 1,
        "method": calibration.method,
        "kernel": calibration.kernel,
        "trend": calibration.trend,
        "unit": calibration.unit,
        "f": k.f,
        "uc": k.uc,
        "vc": k.vc,
        "f_std": f_std,
        "uc_std": uc_std,
        "vc_std": vc_std,
        "closed_form": None if closed is None else {"f": closed.f, "uc": closed.uc, "vc": closed.vc},
        "square_mm": calibration.square_mm,
        "reference": calibration.reference,
        "mirrored": calibration.camera.mirrored,
        "boards": [
            {
                "file": b.file,
                "used": b.used,
                "reason": b.reason,
                "note": b.note,
                "corners": b.corners,
                "inside": b.inside,
                "wrong": b.wrong,
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
        "wrong_corners": _wrong(evaluation),
        "noise_px": calibration.camera.noise_px,
        "heldout_px": evaluation.heldout_px,
        "heldout_kfold_px": evaluation.kfold_px,
        "opencv": {
            name: {"insample_px": s.insample_px, "re_percent": s.re_percent, "heldout_px": s.heldout_px}
            for name, s in evaluation.opencv.items()
        },
        "verdict": {
            "level": verdict.level,
            "sentence": verdict.sentence,
            "coverage": verdict.coverage,
            "residual_correlation": verdict.structure.correlation,
            "residual_structure_p_value": verdict.structure.p_value,
            "wrong_corners_structure_p_value": verdict.left_out.p_value,
            "board_error_px": verdict.shared.rms_px,
            "board_error_p_value": verdict.shared.p_value,
            "suspicious_boards": {s.name: s.ratio for s in verdict.suspicious},
            "next_board_px": None if verdict.next_board is None else verdict.next_board.outline.tolist(),
        },
        "details": calibration.details,
    }


def print_evaluation(evaluation: Evaluation, verdict: Verdict) -> None:
    """The evaluation for people, on standard output; lines are never broken, and coloured only on a terminal."""
    from rich.console import Console
    from rich.markup import escape

    console = Console(highlight=False, soft_wrap=True)
    calibration = evaluation.calibration
    used = sum(b.used for b in evaluation.boards)
    found = sum(b.corners > 0 for b in evaluation.boards)
    console.print(
        f"[bold]{calibration.method}[/] camera from [bold]{escape(calibration.reference)}[/]: "
        f"{used} of {found} boards count ({len(evaluation.boards)} images)"
    )
    for name, value in _facts(evaluation):
        console.print(f"  {name:12s} {value}")
    console.print(_comparison(evaluation))
    if evaluation.opencv and _board_shape(calibration):
        console.print(f"  {SHAPES}")
    if evaluation.heldout_px is None and evaluation.heldout_reason:
        console.print(f"  no held-out error: {escape(evaluation.heldout_reason)}")
    console.print(f"[bold]{escape(textwrap.fill(verdict.sentence, WIDTH))}[/]")
    for line in (*sentences(evaluation.wrong), *_set_aside(evaluation), *_renumbered(evaluation)):
        console.print(f"  [dim]{escape(line)}[/]")


def _facts(evaluation: Evaluation) -> list[tuple[str, str]]:
    """What is said in a line each: its name and its value."""
    calibration, pooled, rest = evaluation.calibration, evaluation.pooled, evaluation.pooled_without_reference
    k = calibration.camera.intrinsics
    lengths = zip(("f", "uc", "vc"), (k.f, k.uc, k.vc), calibration.intrinsics_std, strict=True)
    facts = [("trend", f"{calibration.trend}, kernel {calibration.kernel}")]
    facts += [
        (name, f"{value:.5f}{_spread(std)} {calibration.unit}{_in_millimetres(value, calibration)}")
        for name, value, std in lengths
    ]
    if np.isfinite(calibration.camera.noise_px):
        facts.append(("noise", f"{calibration.camera.noise_px:.3f} px"))
    facts += [
        ("CE", f"{pooled.ce * 1e4:.3f}e-4 ({rest.ce * 1e4:.3f}e-4 without the reference)"),
        ("RE", f"{pooled.re_percent:.3f} % closed form"),
        ("RE, refined", f"{pooled.re_refined_percent:.3f} % ({pooled.re_px:.3f} px)"),
    ]
    facts += _board_shape(calibration)
    if evaluation.pinholeness is not None:
        facts.append(("pinholeness", f"{evaluation.pinholeness:.2e} of f"))
    if evaluation.kfold_px is not None:
        facts.append(("held out", f"{evaluation.kfold_px:.3f} px over five folds"))
    return facts


def _spread(std: float) -> str:
    """± and the standard deviation, where one is known: an imported camera brings none."""
    return f" ± {std:.5f}" if np.isfinite(std) else ""


def _board_shape(calibration: Calibration) -> list[tuple[str, str]]:
    """What was found of a board that is not flat or not square, and of boards that moved: never silently."""
    bow, stretch = calibration.details.get("board_bow_squares"), calibration.details.get("board_stretch")
    facts = []
    if isinstance(bow, float):
        facts.append(("board's bow", f"{bow:.4f} squares{_millimetres(bow, calibration.square_mm)}"))
    if isinstance(stretch, float):
        lean = calibration.details.get("board_shear") or 0.0
        facts.append(("its print", f"{stretch:+.3%} longer along y than along x, leaning by {lean:+.3%}"))
    warp = calibration.details.get("board_warp_squares")
    if isinstance(warp, float):
        millimetres = _millimetres(warp, calibration.square_mm)
        facts.append(("its corners", f"{warp:.4f} squares{millimetres} off beyond that, rms"))
    moved = calibration.details.get("motion_px")
    if isinstance(moved, float) and moved > 0.0:
        facts.append(("motion", f"{moved:.3f} px while the shutter rolled"))
    return facts


def _set_aside(evaluation: Evaluation) -> list[str]:
    """Boards that were found and do not count, and why; a long list is cut."""
    aside = [b for b in evaluation.boards if b.corners and not b.used]
    lines = [f"{b.file} does not count: {b.reason}" for b in aside[:ASIDE_SHOWN]]
    more = len(aside) - len(lines)
    return lines + ([f"{more} more do not count; --json tells why for each"] if more else [])


def _renumbered(evaluation: Evaluation) -> list[str]:
    """Boards whose corners were numbered anew."""
    return [f"{b.file} was {b.note}" for b in evaluation.boards if b.note]


def _in_millimetres(length: float, calibration: Calibration) -> str:
    """``length`` of the virtual plane in mm, where its unit is the board's square."""
    return _millimetres(length, calibration.square_mm) if calibration.unit == "squares" else ""


def _millimetres(squares: float, square_mm: float | None) -> str:
    return "" if square_mm is None else f"  ({squares * square_mm:.3f} mm)"


def _comparison(evaluation: Evaluation) -> Table:
    """Held-out and in-sample errors, never in one column."""
    from rich.table import Table

    pooled = evaluation.pooled
    made_from_these = _boards_are_those_of_the_camera(evaluation)
    table = Table("model", "held out, px", "in sample, px", "RE in sample, %", box=None, pad_edge=True)
    table.add_row(
        f"pinholify {evaluation.calibration.method}",
        _number(evaluation.heldout_px),
        _number(pooled.re_px if made_from_these else None),
        _number(pooled.re_refined_percent if made_from_these else None),
        style="bold",
    )
    for name, score in evaluation.opencv.items():
        table.add_row(name, _number(score.heldout_px), _number(score.insample_px), _number(score.re_percent))
    return table


def _boards_are_those_of_the_camera(evaluation: Evaluation) -> bool:
    """Whether the camera was made from these boards: on others its error is not in-sample."""
    known = {view.name: len(view) for view in evaluation.calibration.corner_set.views}
    return all(known.get(board.file) == board.corners for board in evaluation.boards if board.used)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
