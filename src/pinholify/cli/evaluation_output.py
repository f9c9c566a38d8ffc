"""The output of ``calibrate``, ``evaluate`` and ``demo``: an evaluation as text, and as JSON."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from pinholify.calibration.result import IMPORTED, Calibration
from pinholify.evaluation.summary import Evaluation
from pinholify.evaluation.verdict import Verdict
from pinholify.evaluation.wrong_corners import sentences

if TYPE_CHECKING:  # slow to import, and --json needs no table
    from rich.table import Table

BOARD_KEYS = (
    "file", "used", "reason", "note", "corners", "inside", "wrong", "ce", "re_percent", "re_refined_percent",
)  # fmt: skip
ASIDE_SHOWN = 8
WIDTH = 78
SHAPES = "pinholify is scored with the board shape that it found, OpenCV's models with a flat board"


def to_json(evaluation: Evaluation, verdict: Verdict) -> dict[str, Any]:
    """The object that ``--json`` prints; its keys are fixed."""
    calibration, wrong = evaluation.calibration, evaluation.wrong
    closed = calibration.closed_form
    f_std, uc_std, vc_std = (float(s) for s in calibration.intrinsics_std)
    return {
        "format_version": 1,
        **_members(calibration, ("method", "kernel", "trend", "unit")),
        **asdict(calibration.camera.intrinsics),
        "f_std": f_std,
        "uc_std": uc_std,
        "vc_std": vc_std,
        "closed_form": None if closed is None else asdict(closed),
        "square_mm": calibration.square_mm,
        "reference": calibration.reference,
        "mirrored": calibration.camera.mirrored,
        "boards": [_members(board, BOARD_KEYS) for board in evaluation.boards],
        **asdict(evaluation.pooled),
        "without_reference": asdict(evaluation.pooled_without_reference),
        "pinholeness": evaluation.pinholeness,
        "wrong_corners": {
            "count": wrong.count, "of": wrong.found, "share": wrong.share, "by_image": wrong.counts,
            "crowded": list(wrong.crowded),
        },
        "noise_px": calibration.camera.noise_px,
        "heldout_px": evaluation.heldout_px,
        "heldout_kfold_px": evaluation.kfold_px,
        "opencv": {name: asdict(score) for name, score in evaluation.opencv.items()},
        "verdict": _verdict(verdict),
        "details": calibration.details,
    }  # fmt: skip


def _members(source: object, names: Iterable[str]) -> dict[str, Any]:
    return {name: getattr(source, name) for name in names}


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {
        "level": verdict.level,
        "sentence": verdict.sentence,
        "coverage": verdict.coverage,
        "residual_correlation": verdict.structure.correlation,
        "residual_structure_p_value": verdict.structure.p_value,
        "wrong_corners_structure_p_value": verdict.left_out.p_value,
        "board_error_px": verdict.shared.rms,
        "board_error_p_value": verdict.shared.p_value,
        "suspicious_boards": {s.name: s.ratio for s in verdict.suspicious},
        "next_board_px": None if verdict.next_board is None else verdict.next_board.outline.tolist(),
    }


def print_evaluation(evaluation: Evaluation, verdict: Verdict) -> None:
    """Print the evaluation as text on standard output; lines are never wrapped, and coloured only on a terminal."""
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
    if evaluation.heldout.px is None:
        console.print(f"  no held-out error: {escape(evaluation.heldout.reason)}")
    console.print(f"[bold]{escape(textwrap.fill(verdict.sentence, WIDTH))}[/]")
    for line in (*sentences(evaluation.wrong), *_set_aside(evaluation), *_renumbered(evaluation)):
        console.print(f"  [dim]{escape(line)}[/]")


def _facts(evaluation: Evaluation) -> list[tuple[str, str]]:
    """The (name, value) pairs that are printed one per line."""
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
    """± and the standard deviation; empty if there is none, as for an imported camera."""
    return f" ± {std:.5f}" if np.isfinite(std) else ""


def _board_shape(calibration: Calibration) -> list[tuple[str, str]]:
    """(name, value) pairs for a board that is not flat or not square, and for boards that moved."""
    found, facts = calibration.findings, []
    if found.board_bow_squares is not None:
        bow = found.board_bow_squares
        facts.append(("board's bow", f"{bow:.4f} squares{_millimetres(bow, calibration.square_mm)}"))
    if found.board_stretch is not None:
        longer, lean = 100 * found.board_stretch, 100 * (found.board_shear or 0.0)
        facts.append(("its print", f"{longer:+.3f} % longer along y than along x, leaning by {lean:+.3f} %"))
    if found.board_warp_squares is not None:
        warp = found.board_warp_squares
        millimetres = _millimetres(warp, calibration.square_mm)
        facts.append(("its corners", f"{warp:.4f} squares{millimetres} RMS beyond that"))
    if found.motion_px > 0.0:
        facts.append(("motion", f"{found.motion_px:.3f} px RMS per axis during the rolling shutter"))
    return facts


def _set_aside(evaluation: Evaluation) -> list[str]:
    """Lines on boards that were found but do not count, and why; a long list is cut."""
    aside = [b for b in evaluation.boards if b.corners and not b.used]
    lines = [f"{b.file} does not count: {b.reason}" for b in aside[:ASIDE_SHOWN]]
    more = len(aside) - len(lines)
    return lines + ([f"{more} more do not count; --json gives the reason for each"] if more else [])


def _renumbered(evaluation: Evaluation) -> list[str]:
    """Lines on boards whose corners were renumbered, one for each reason."""
    files: dict[str, list[str]] = {}
    for board in evaluation.boards:
        if board.note:
            files.setdefault(board.note, []).append(board.file)
    return [
        f"{names[0]} was {note}" if len(names) == 1 else f"{len(names)} boards were {note}: {', '.join(names)}"
        for note, names in files.items()
    ]


def _in_millimetres(length: float, calibration: Calibration) -> str:
    """``length`` on the virtual plane in mm; empty unless its unit is the board's square."""
    return _millimetres(length, calibration.square_mm) if calibration.unit == "squares" else ""


def _millimetres(squares: float, square_mm: float | None) -> str:
    return "" if square_mm is None else f"  ({squares * square_mm:.3f} mm)"


def _comparison(evaluation: Evaluation) -> Table:
    """The table of held-out and in-sample errors, which never share a column."""
    from rich.table import Table

    calibration, pooled = evaluation.calibration, evaluation.pooled
    in_sample = evaluation.in_sample
    table = Table("model", "held out, px", "in sample, px", "RE in sample, %", box=None, pad_edge=True)
    table.add_row(
        "the imported camera" if calibration.method == IMPORTED else f"pinholify {calibration.method}",
        _number(evaluation.heldout_px),
        _number(pooled.re_px if in_sample else None),
        _number(pooled.re_refined_percent if in_sample else None),
        style="bold",
    )
    for name, score in evaluation.opencv.items():
        table.add_row(name, _number(score.heldout_px), _number(score.insample_px), _number(score.re_percent))
    return table


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
