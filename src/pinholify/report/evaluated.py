"""A calibration scored on the corners it was made from."""

from __future__ import annotations

from functools import partial

from pinholify.calibration.result import Calibration
from pinholify.errors import InputError
from pinholify.evaluation.summary import Evaluation, evaluate
from pinholify.evaluation.verdict import Verdict, judge
from pinholify.pipeline import recalibrate


def evaluated(calibration: Calibration, *, opencv: bool = True, heldout: bool = True) -> tuple[Evaluation, Verdict]:
    """Evaluate ``calibration`` on the corners it was made from, and judge it.

    ``opencv`` also fits OpenCV's models; ``heldout`` calibrates again on half of the boards. Raises InputError for a
    camera that was made from no corners (an imported one), CalibrationError where no board can be scored.
    """
    if not calibration.corner_set.found:
        raise InputError(
            "the camera file holds no corners, as after 'pinholify import' or 'pinholify mode', so there is nothing to "
            "report on; score it on photographs of a board with 'pinholify evaluate'"
        )
    corners = calibration.corner_set
    again = partial(recalibrate, calibration) if heldout else None
    evaluation = evaluate(calibration, corners, recalibrate=again, compare_opencv=opencv)
    return evaluation, judge(evaluation, corners)
