"""A calibration scored on its own corners, as a report wants it."""

from __future__ import annotations

from pinholify.calibration.result import Calibration
from pinholify.corners import CornerSet
from pinholify.errors import InputError
from pinholify.evaluation.summary import Evaluation, evaluate
from pinholify.evaluation.verdict import Verdict, judge
from pinholify.pipeline import calibrate


def evaluated(calibration: Calibration, *, opencv: bool = True, heldout: bool = True) -> tuple[Evaluation, Verdict]:
    """Evaluation of ``calibration`` on the corners it was made from, and the verdict.

    ``opencv`` fits OpenCV's models beside it; ``heldout`` calibrates half of the boards anew, in the same way. Raises
    InputError for a camera that was made from no corners (an imported one), CalibrationError where no board can be
    scored.
    """
    if not calibration.corner_set.found:
        raise InputError(
            f"the camera was made from no photographs ({calibration.method}), so there is nothing to report on; see "
            "how good it is on photographs of a board with 'pinholify evaluate'"
        )

    def again(part: CornerSet, reference: str) -> Calibration:
        return calibrate(
            part,
            reference=reference,
            method=calibration.method,
            kernel=calibration.kernel,
            trend=calibration.trend if calibration.method == "one-image" else "auto",
            mirrored=calibration.camera.mirrored,
        )

    corners = calibration.corner_set
    evaluation = evaluate(calibration, corners, recalibrate=again if heldout else None, compare_opencv=opencv)
    return evaluation, judge(evaluation, corners)
