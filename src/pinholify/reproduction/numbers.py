"""All numbers of a reproduction as one JSON-serialisable object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from pinholify import __version__
from pinholify.evaluation.summary import Evaluation
from pinholify.reproduction.chain import Attempt, Reproduced
from pinholify.reproduction.findings import findings
from pinholify.reproduction.tables import reported


def all_numbers(results: Sequence[Reproduced], *, quick: bool, seconds: float) -> dict[str, Any]:
    """All measures by data set, and the findings on the paper's claims."""
    return {
        "format_version": 1,
        "version": __version__,
        "quick": quick,
        "seconds": round(seconds, 1),
        "data_sets": {r.dataset.name: _data_set(r) for r in results},
        "findings": [asdict(finding) for finding in findings(results)],
    }


def _data_set(result: Reproduced) -> dict[str, Any]:
    theirs = reported(result)
    return {
        "title": result.dataset.title,
        "image_size": list(result.corner_set.image_size),
        "board": result.dataset.board.spec,
        "boards": len(result.corner_set.views),
        "found": len(result.corner_set.found),
        "corners": sum(map(len, result.corner_set.found)),
        "corner_errors": asdict(result.corner_errors),
        "reported": None if theirs is None else asdict(theirs),
        "exact_corners": asdict(result.exact),
        "heldout_floor_px": result.heldout_floor_px,
        "opencv": {name: asdict(score) for name, score in result.ours.evaluation.opencv.items()},
        "constant_mean": _attempt(result.paper),
        "default_trend": _attempt(result.ours),
    }


def _attempt(attempt: Attempt) -> dict[str, Any]:
    evaluation = attempt.evaluation
    k = evaluation.calibration.camera.intrinsics
    return {
        "trend": evaluation.calibration.trend,
        "kernel": evaluation.calibration.kernel,
        "counted": len(evaluation.observed),
        "f_uc_vc": [k.f, k.uc, k.vc],
        "f_uc_vc_std": [float(s) for s in evaluation.calibration.intrinsics_std],
        "noise_px": evaluation.calibration.camera.noise_px,
        "pooled": asdict(evaluation.pooled),
        "pooled_without_reference": asdict(evaluation.pooled_without_reference),
        "pinholeness": evaluation.pinholeness,
        "heldout_px": evaluation.heldout_px,
        "against_truth": asdict(attempt.truth),
        "boards": _boards(evaluation),
    }


def _boards(evaluation: Evaluation) -> list[dict[str, Any]]:
    return [asdict(board) for board in evaluation.boards]
