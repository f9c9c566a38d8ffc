"""The tables, as text: the paper's two next to ours, held-out errors, and errors against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pinholify.evaluation.summary import Evaluation
from pinholify.report.numerals import number
from pinholify.reproduction.chain import Attempt, Reproduced
from pinholify.reproduction.paper import REPORTED, Reported


@dataclass(frozen=True, slots=True)
class Table:
    """A ``title``, a ``header`` and ``rows`` of text cells, and a ``note`` that explains them."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str


def all_tables(results: Sequence[Reproduced]) -> tuple[Table, ...]:
    """Every table of the reproduction, in reading order."""
    return (data_sets(results), errors(results), held_out(results), without_noise(results), against_truth(results))


def reported(result: Reproduced) -> Reported | None:
    """The paper's numbers for the data set of ``result``, None if it has none."""
    return REPORTED.get(result.dataset.name)


def data_sets(results: Sequence[Reproduced]) -> Table:
    """The paper's Table 1, with the boards that were rendered, found and counted."""
    rows = []
    for r in results:
        theirs, views = reported(r), r.corner_set.views
        rows.append(
            (
                r.dataset.title,
                "–" if theirs is None else f"{theirs.boards} of {theirs.corners}, {_size(theirs.size)}",
                f"{len(views)} of {r.dataset.board.spec}, {_size(r.corner_set.image_size)}",
                str(len(r.corner_set.found)),
                str(len(r.paper.evaluation.observed)),
                f"{r.corner_errors.rms_px:.3f}",
                f"{r.corner_errors.shift_px[0]:+.4f}, {r.corner_errors.shift_px[1]:+.4f}",
            )
        )
    header = ("data set", "the paper's boards", "ours", "found", "counted", "corner error, px", "mean shift u, v, px")
    note = (
        "A board counts if at least 90 % of its corners lie inside the outline of the reference board. Corner error: "
        "RMS distance between detected and rendered corners; mean shift: detected minus rendered."
    )
    return Table("Table 1. The data sets", header, tuple(rows), note)


def errors(results: Sequence[Reproduced]) -> Table:
    """The paper's Table 2 and ours, with OpenCV's models instead of MATLAB's."""
    rows = []
    for r in results:
        theirs, paper, ours = reported(r), r.paper.evaluation, r.ours.evaluation
        rows.append(
            (
                r.dataset.title,
                number(None if theirs is None else theirs.ce * 1e4, 3),
                number(None if theirs is None else theirs.re, 4),
                number(None if theirs is None else theirs.matlab_re, 4),
                *_gp_errors(paper),
                *_gp_errors(ours),
                number(ours.opencv["opencv5"].re_percent, 4),
                number(ours.opencv["opencv8"].re_percent, 4),
            )
        )
    header = (
        "data set",
        "paper: GP CE ×1e-4",
        "paper: GP RE",
        "paper: MATLAB RE",
        "constant mean: CE ×1e-4",
        "RE %, closed form",
        "RE %, refined",
        "default trend: CE ×1e-4",
        "RE %, closed form",
        "RE %, refined",
        "OpenCV-5 RE %",
        "OpenCV-8 RE %",
    )
    note = (
        "The paper gives no unit for its reprojection errors; they agree with its collinearity errors when read as per "
        "cent of the corner spacing. Constant mean: the paper's own method. All errors are in-sample, over the boards "
        "that count."
    )
    return Table("Table 2. Collinearity errors (CE) and reprojection errors (RE)", header, tuple(rows), note)


def _gp_errors(evaluation: Evaluation) -> tuple[str, str, str]:
    pooled = evaluation.pooled
    return f"{pooled.ce * 1e4:.3f}", f"{pooled.re_percent:.4f}", f"{pooled.re_refined_percent:.4f}"


def held_out(results: Sequence[Reproduced]) -> Table:
    """Errors on boards that no model was trained on, in px."""
    rows = []
    for r in results:
        theirs, paper, ours = reported(r), r.paper.evaluation, r.ours.evaluation
        rows.append(
            (
                r.dataset.title,
                number(paper.heldout_px, 4),
                number(ours.heldout_px, 4),
                *(number(ours.opencv[model].heldout_px, 4) for model in ("opencv5", "opencv8", "fisheye")),
                number(r.heldout_floor_px, 4),
                number(ratio(ours.opencv["opencv5"].heldout_px, ours.heldout_px), 3),
                "–" if theirs is None else number(theirs.matlab_re / theirs.re, 2),
            )
        )
    header = (
        "data set",
        "constant mean",
        "default trend",
        "OpenCV-5",
        "OpenCV-8",
        "OpenCV fisheye",
        "true lens",
        "OpenCV-5 ÷ default trend",
        "paper: MATLAB RE ÷ GP RE",
    )
    note = (
        "RMS per point in px of the original image, on boards held out of training with only their poses refitted, for "
        "the same corners with every model. The GP's map is made from one photograph, OpenCV's models from half of all "
        "boards; the true lens shows what corner noise leaves."
    )
    return Table("Held-out errors", header, tuple(rows), note)


def without_noise(results: Sequence[Reproduced]) -> Table:
    """Errors of the paper's method on corners without noise."""
    rows = tuple(
        (
            r.dataset.title,
            "yes" if r.dataset.lens.central else "no",
            f"{r.exact.ce * 1e4:.3f}",
            f"{r.exact.re_percent:.4f}",
            f"{r.exact.re_refined_percent:.4f}",
        )
        for r in results
    )
    header = ("data set", "rays meet in one point", "CE ×1e-4", "RE %, closed form", "RE %, refined")
    note = (
        "The same boards and the same method (constant mean), with rendered instead of detected corners. The remaining "
        "error is that of the method, or of a camera without a single centre."
    )
    return Table("Without noise", header, rows, note)


def against_truth(results: Sequence[Reproduced]) -> Table:
    """Map, K and poses against the rendered truth, one row per calibration."""
    rows = [
        (f"{r.dataset.title}, {name}", *_truth_cells(attempt))
        for r in results
        for name, attempt in (("constant mean", r.paper), ("default trend", r.ours))
    ]
    header = (
        "data set, calibration",
        "trend chosen",
        "map, px",
        "true f, uc, vc, squares",
        "found minus true, squares",
        "poses: rotation, °",
        "poses: centre, squares",
        "pinholeness, f",
        "CE ×1e-4 without the reference",
    )
    note = (
        "Map: RMS error inside the reference board after removing the best homography. Poses: RMS over boards, "
        "relative to the reference board, in closed form → refined. Pinholeness: mean distance of 100 lines of sight "
        "from the origin. A mirror's rays have no common centre, so there are no true f, uc, vc."
    )
    return Table("Against truth", header, tuple(rows), note)


def _truth_cells(attempt: Attempt) -> tuple[str, ...]:
    truth, evaluation = attempt.truth, attempt.evaluation
    closed, refined = truth.closed_form, truth.refined
    return (
        evaluation.calibration.trend,
        f"{truth.map_px:.4f}",
        "none" if truth.intrinsics is None else ", ".join(f"{x:.4f}" for x in truth.intrinsics),
        "–" if truth.intrinsics_error is None else ", ".join(f"{x:+.4f}" for x in truth.intrinsics_error),
        f"{closed.turn_degrees:.4f} → {refined.turn_degrees:.4f}",
        f"{closed.middle_squares:.4f} → {refined.middle_squares:.4f}",
        "–" if evaluation.pinholeness is None else f"{evaluation.pinholeness:.1e}",
        f"{evaluation.pooled_without_reference.ce * 1e4:.3f}",
    )


def ratio(above: float | None, below: float | None) -> float | None:
    """``above`` ÷ ``below``, None unless both exist."""
    return None if above is None or not below else above / below



def _size(size: tuple[int, int]) -> str:
    return f"{size[0]}×{size[1]}"
