"""One data set from rendered photographs to numbers: corners from pixels, and two calibrations."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pinholify.calibration.result import Calibration
from pinholify.corners import CornerSet
from pinholify.detection import detect_files
from pinholify.evaluation.summary import Evaluation, Pooled, evaluate
from pinholify.geometry import Pose
from pinholify.pipeline import calibrate, recalibrate
from pinholify.reproduction.photographs import photograph_files, render_photographs, rendered_before
from pinholify.reproduction.truth import (
    CornerErrors,
    TruthErrors,
    corner_errors,
    exact_corners,
    heldout_floor,
    numbered_poses,
    truth_errors,
)
from pinholify.simulation.datasets import Dataset, mirrored

Watch = Callable[[str, int | None], AbstractContextManager[Callable[[], None]]]
"""Called with a task and its number of parts (or None); yields the function to call after each part."""

PAPERS, OURS = "constant", "auto"
"""The trends of the two calibrations: the paper's constant mean, and the default."""


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One calibration of a data set, scored on all its boards and against the truth."""

    evaluation: Evaluation
    truth: TruthErrors


@dataclass(frozen=True, slots=True, eq=False)
class Reproduced:
    """The results of a data set: ``paper`` by the paper's method, ``ours`` with the default trend.

    ``exact`` are the errors of the paper's method on corners without noise, which are due to the method itself or to a
    camera without a single centre. ``heldout_floor_px`` is the held-out error of the true lens, due to noise alone.
    """

    dataset: Dataset
    files: tuple[Path, ...]
    corner_set: CornerSet
    corner_errors: CornerErrors
    paper: Attempt
    ours: Attempt
    exact: Pooled
    heldout_floor_px: float | None


def reproduce_dataset(
    dataset: Dataset, views: int, folder: Path, watch: Watch, *, workers: int | None = 1
) -> Reproduced:
    """Render the first ``views`` photographs under ``folder``, detect their corners, calibrate twice and score.

    The first photograph, whose board fills the frame, is the reference. OpenCV's models are fitted once, since both
    calibrations use the same boards. ``workers`` processes detect corners (None: one per CPU).
    """
    files = photograph_files(dataset, views, folder)
    if not rendered_before(dataset, files):
        with watch(f"{dataset.title}: rendering", views) as advance:
            render_photographs(dataset, files, advance)
    with watch(f"{dataset.title}: finding corners", views) as advance:
        corner_set = detect_files(
            files,
            dataset.board,
            mirrored=mirrored(dataset.lens),
            workers=workers,
            on_result=lambda _: advance(),
        )
    poses = numbered_poses(dataset, corner_set)
    with watch(f"{dataset.title}: calibrating", 3) as advance:
        paper = _attempt(dataset, corner_set, poses, PAPERS, compare_opencv=False)
        advance()
        ours = _attempt(dataset, corner_set, poses, OURS, compare_opencv=True)
        advance()
        without_noise = exact_corners(dataset, corner_set, poses)
        exact = evaluate(_calibrated(dataset, without_noise, PAPERS), without_noise, compare_opencv=False).pooled
        advance()
    counted = [view for view in corner_set.views if view.name in ours.evaluation.observed]
    return Reproduced(
        dataset,
        tuple(files),
        corner_set,
        corner_errors(dataset, corner_set, poses),
        paper,
        ours,
        exact,
        heldout_floor(dataset.lens, corner_set, counted, poses.values()),
    )


def _attempt(
    dataset: Dataset, corner_set: CornerSet, poses: dict[str, Pose], trend: str, *, compare_opencv: bool
) -> Attempt:
    calibration = _calibrated(dataset, corner_set, trend)
    again = partial(recalibrate, calibration)
    evaluation = evaluate(calibration, corner_set, recalibrate=again, compare_opencv=compare_opencv)
    return Attempt(evaluation, truth_errors(dataset, evaluation, poses))


def _calibrated(dataset: Dataset, corner_set: CornerSet, trend: str) -> Calibration:
    """The one-image calibration from the board in the first view."""
    name = corner_set.views[0].name
    return calibrate(corner_set, method="one-image", trend=trend, reference=name, mirrored=mirrored(dataset.lens))
