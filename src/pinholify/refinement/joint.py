"""The joint refinement from corners to a camera: :func:`refine` runs the stages, which have a module each.

The order is start, screening of wrong corners, choice of the trend, full solve with cleaning, and result. Where the
finished solve indicates a warp or motions of the boards, trend and solve are repeated with them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Floats
from pinholify.calibration.methods import FEWEST_BOARDS
from pinholify.camera import VirtualCamera
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CalibrationError
from pinholify.refinement.candidates import Candidate, Setting, candidates, contest
from pinholify.refinement.cleaning import Cleaned, clean, screen, spoilt
from pinholify.refinement.disagreement import disagreement
from pinholify.refinement.motion import motion_of, motion_rms
from pinholify.refinement.observations import (
    MANY_BOARDS,
    ImageFrame,
    Observations,
    image_frame,
    lattice_middle,
    observations,
)
from pinholify.refinement.outliers import coherent, usable_views
from pinholify.refinement.result import (
    JointResult,
    camera_of,
    intrinsics_covariance,
    joint_map,
    poses_of,
    shape_of,
)
from pinholify.refinement.settle import SolveError, best_shape
from pinholify.refinement.shape import BEND, STRETCH, WARP, board_shape
from pinholify.refinement.solver import Solution
from pinholify.refinement.spectral import density_named
from pinholify.refinement.start import first_solution, given_lens
from pinholify.refinement.trends import Search, searches_named
from pinholify.refinement.warp import warp_of, warp_rms

SHORTEST_LENGTH_SCALE = 4.0  # of the prior, in typical distances between neighbouring corners of one board
MAX_EXTENSIONS = 2  # of the model, because one may hide another
COVERED_QUANTILE = 0.995  # of the corners' radii: those farther out may be wrong
SECOND_CHOICES = 8  # candidates to solve where no finalist can be solved

Progress = Callable[[str], None]


def refine(
    corner_set: CornerSet,
    *,
    reference: str,
    stand_ins: Sequence[str] = (),
    mirrored: bool = False,
    kernel: str = "se",
    trend: str = "auto",
    start: VirtualCamera | None = None,
    progress: Progress | None = None,
) -> JointResult:
    """The camera that all boards of ``corner_set`` determine together.

    ``reference`` is the name of the view whose board fixes the camera's frame; where that view cannot be used, the
    first of the ``stand_ins`` that can takes its place. ``mirrored`` means that the image is a reflection, in which
    lattices are left-handed. ``kernel`` and ``trend`` are names of the registries. ``start`` is a camera close to the
    one sought. ``progress`` is called with one line per stage. Raises InputError for unknown names and for a start of
    another image size, and CalibrationError where the corners do not determine a camera.
    """
    say = progress or (lambda _: None)
    density, scales = density_named(kernel)
    stages = searches_named(trend)
    views, unusable = usable_views(corner_set.views, corner_set.board, mirrored)
    references = (reference, *stand_ins)
    _check_used(references, views, unusable)
    frame = image_frame(corner_set.image_size, mirrored)
    given = None if start is None else given_lens(start, frame, corner_set.image_size)
    everything = observations(views, corner_set.board, frame)
    setting = Setting(
        density,
        scales,
        board_shape(corner_set.board),
        frame.half_size,
        _covered(everything),
        SHORTEST_LENGTH_SCALE * _spacing(everything),
    )
    first, fits = first_solution(setting, everything.select(coherent(everything)).thinned(), given)
    say(f"start: residuals of {first.noise * frame.scale:.3g} px")
    finalists, seen, cleaned = _extended(setting, stages, first, everything, trend, say)
    for candidate in finalists:
        say(f"trend {candidate.name}: log evidence {_per_px(candidate.log_evidence, seen, frame):.1f}")
    used = [view for view in views if view.name in cleaned.seen.names]
    _check_used(references, used, {**unusable, **cleaned.misfits})
    reference = next(name for name in references if name in cleaned.seen.names)
    settled = cleaned.settled
    say(f"noise {settled.hyperparameters.noise * frame.scale:.4g} px with trend {settled.model.trend.name}")
    evidences = tuple((c.name, _per_px(c.log_evidence, seen, frame)) for c in finalists)
    return replace(_result(corner_set, cleaned, frame, reference, kernel, evidences, unusable), start_fits=fits)


def _extended(
    setting: Setting,
    stages: Sequence[Sequence[Search]],
    first: Solution,
    everything: Observations,
    trend: str,
    say: Progress,
) -> tuple[list[Candidate], Observations, Cleaned]:
    """The finalists, the corners that ranked them, and the finished solve, with its model extended where needed."""
    seen, known = screen(first, everything)
    finalists, cleaned = _refined(setting, stages, known, seen, everything, trend)
    for extension in range(MAX_EXTENSIONS):
        richer = _richer(setting, cleaned, say)
        if richer is setting and (extension or not cleaned.rechoose):
            break
        say("choosing the trend again")
        moving = richer.motion and not setting.motion  # what looked like boards' noise may be their motion
        setting, seen, known = richer, cleaned.seen, cleaned.settled.solution
        finalists, cleaned = _refined(setting, stages, known, seen, everything if moving else cleaned.everything, trend)
    return finalists, seen, cleaned


def _refined(
    setting: Setting,
    stages: Sequence[Sequence[Search]],
    known: Solution,
    seen: Observations,
    everything: Observations,
    trend: str,
) -> tuple[list[Candidate], Cleaned]:
    """The finalists, best first, and the cleaned full solve of the first one that can be solved."""
    tried = _ranked(setting, stages, known, seen)
    if tried and spoilt(tried[0].origin, seen):  # by corners that the first solution took for good ones
        seen, known = screen(tried[0].origin, seen)
        tried = _ranked(setting, stages, known, seen)
    finalists = contest(setting, stages, tried, seen)
    for candidate in (*finalists, *tried[:SECOND_CHOICES]):
        shape, fitted = best_shape(setting, candidate)
        try:
            return finalists, clean(replace(setting, shape=shape), fitted, seen, everything)
        except SolveError:
            continue
    raise CalibrationError(
        f"no camera with trend '{trend}' fits the corners: look for wrong boards, or choose the trend 'auto'"
    )


def _richer(setting: Setting, cleaned: Cleaned, say: Progress) -> Setting:
    """``setting`` with what the finished solve indicates: a warp of the board, or motions of the boards.

    Few boards do not separate motions from the board's shape, or from a stretch of the print: where they indicate
    motions, they get neither.
    """
    solution, seen = cleaned.settled.solution, cleaned.seen
    if setting.shape.has(STRETCH) and not setting.shape.has(WARP):  # a board that was printed
        warped = warp_of(solution, setting.shape, seen, setting.density, cleaned.settled.hyperparameters)
        if warped is not None:
            say("the board's corners have the same errors in all views: the board is solved with a warp")
            setting = replace(setting, shape=warped)
    if not setting.motion and (motion := motion_of(solution, seen)):
        if seen.boards >= MANY_BOARDS:
            say("the boards moved while the shutter rolled: each is solved with its own motion")
            setting = replace(setting, motion=motion)
        elif setting.shape.has(STRETCH):
            say("the boards differ by more than noise and are too few to determine the stretch of the print")
            setting = replace(setting, shape=setting.shape.of(BEND))
    return setting


def _ranked(
    setting: Setting, stages: Sequence[Sequence[Search]], known: Solution, seen: Observations
) -> list[Candidate]:
    """All candidates, best first."""
    return sorted(candidates(setting, stages, known, seen), key=lambda candidate: -candidate.score)


def _check_used(references: Sequence[str], used: Sequence[Corners], unused: Mapping[str, str]) -> None:
    """Raise CalibrationError where none of ``references`` is among the ``used`` views, or these are too few."""
    if not {view.name for view in used}.intersection(references):
        reason = unused.get(references[0])
        cause = f"cannot be used ({reason})" if reason else "is not among the views"
        raise CalibrationError(f"the reference '{references[0]}' {cause}: choose another reference")
    if len(used) < FEWEST_BOARDS:
        raise CalibrationError(
            f"{len(used)} of the boards can be used, but the joint refinement needs at least {FEWEST_BOARDS}: "
            "take more photographs"
        )


def _spacing(seen: Observations) -> float:
    """Median distance between neighbouring corners of one board, normalised."""
    nearest = [cKDTree(seen.image[rows]).query(seen.image[rows], k=2)[0][:, 1] for rows in seen.slices()]
    return float(np.median(np.concatenate(nearest)))


def _covered(seen: Observations) -> Floats:
    """Images (n, 2) of all corners but those farthest from the image's middle, which may be wrong."""
    radius = np.linalg.norm(seen.image, axis=1)
    return np.asarray(seen.image[radius <= np.quantile(radius, COVERED_QUANTILE)])


def _per_px(log_evidence: float, seen: Observations, frame: ImageFrame) -> float:
    """``log_evidence``, a density of normalised corners, as a density of corners in px."""
    return log_evidence - seen.image.size * float(np.log(frame.scale))


def _result(
    corner_set: CornerSet,
    cleaned: Cleaned,
    frame: ImageFrame,
    reference: str,
    kernel: str,
    evidences: tuple[tuple[str, float], ...],
    unusable: Mapping[str, str],
) -> JointResult:
    settled, seen = cleaned.settled, cleaned.seen
    middle = lattice_middle(corner_set.board)
    plane_map = joint_map(settled, seen, frame, seen.names.index(reference), middle)
    plane_map = plane_map.with_disagreement(disagreement(settled, seen, plane_map))
    hyper = settled.hyperparameters
    noise_px = hyper.noise * frame.scale
    motion_px = motion_rms(settled.solution, seen) * frame.scale if settled.model.motion else 0.0
    error_px = float(np.linalg.norm([noise_px, motion_px, warp_rms(settled.solution, seen) * frame.scale]))
    residuals = {name: r * frame.scale * frame.signs for name, r in cleaned.residuals.items()}
    kernel_px = tuple(float(value) * frame.scale for value in np.exp(hyper.kernel))
    return JointResult(
        camera=camera_of(plane_map, seen, corner_set.image_size, noise_px, error_px),
        intrinsics_covariance=intrinsics_covariance(plane_map),
        poses=poses_of(settled, seen, plane_map),
        residuals=residuals,
        inliers=cleaned.inliers,
        dropped={**unusable, **cleaned.misfits},
        noise_px=noise_px,
        kernel=kernel,
        reference=reference,
        trend=settled.model.trend.name,
        candidates=evidences,
        kernel_px=kernel_px,
        shape=shape_of(settled),
        log_evidence=_per_px(settled.log_evidence, seen, frame),
        board_noise_px=_board_noise(corner_set, cleaned, noise_px),
        disagreement=plane_map.disagreement,
        motion_px=motion_px,
        too_few=seen.boards < MANY_BOARDS and motion_of(settled.solution, seen) > 0.0,
    )


def _board_noise(corner_set: CornerSet, cleaned: Cleaned, noise_px: float) -> dict[str, float]:
    """The noise in px of each used view, from how the solve changed the weights of its corners."""
    given = {view.name: float(view.weights[0]) for view in corner_set.found}
    everything = cleaned.everything
    found = dict(zip(everything.names, everything.weight[everything.starts], strict=True))
    return {name: noise_px * given[name] / float(found[name]) for name in cleaned.seen.names}
