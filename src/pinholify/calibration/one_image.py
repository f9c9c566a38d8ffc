"""The paper's method: one image makes the camera, further ones only find three numbers.

The paper takes those from the simplified Zhang's method as they are. Here they are where least squares starts from: on
simulated boards the closed form is two to three times as far from the truth. It is kept beside them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.calibration.condensing import block_side, condensed, condensed_view
from pinholify.calibration.observation import MappedBoard, map_boards, map_views
from pinholify.calibration.poses import Influence, Sighting, influence_on_intrinsics, refine_intrinsics
from pinholify.calibration.result import Calibration
from pinholify.calibration.zhang import (
    TILT_MORE,
    ClosedForm,
    listed,
    pose_from_homography,
    simplified_zhang,
    solve,
)
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import Intrinsics, PlaneChart
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CalibrationError, DegenerateError, InputError
from pinholify.geometry import ConvexRegion, convex_hull, homography_response, normalising_similarity

if TYPE_CHECKING:  # loads SciPy's optimisers, which the joint method does without
    from pinholify.gp.fitting import FittedMap

MINIMUM_REFERENCE_CORNERS = 16
MOST_POINTS = 600  # that the process learns from; denser ones are condensed: it takes n³
MOST_IN_ALL = 12_000
DRAWS = 200
LARGEST_RELATIVE_STD = 0.5
DISAGREEMENT = 2.0  # times the noise's std: a jackknife over unlike boards is itself up to 1.5 times too large


def calibrate_one_image(
    corner_set: CornerSet,
    *,
    reference: str | None = None,
    kernel: str = "se",
    trend: str = "auto",
    mirrored: bool = False,
    square_mm: float | None = None,
) -> Calibration:
    """The virtual camera that one board makes, with K from the others (paper, section 2.2), refined.

    ``reference`` names the board the map is learnt from; by default the one that covers most of the frame. Raises
    InputError for a reference that is not there or is numbered with the wrong handedness, CalibrationError where too
    little is seen, DegenerateError where the boards do not determine K.
    """
    from pinholify.gp.fitting import fit_map

    view = reference_view(corner_set, reference)
    learnt = condensed_view(view, corner_set.board, block_side(len(view), MOST_POINTS))
    lattice = learnt.lattice(corner_set.board)
    fitted = fit_map(learnt.uv, lattice, kernel=kernel, trend=trend, relative_noise=1.0 / learnt.weights)
    hull = convex_hull(view.uv)
    check_handedness(fitted, view, mirrored)
    others = _boards_beside_reference(condensed(corner_set, MOST_IN_ALL), view, fitted, hull)
    common = _common_shifts(others, fitted)
    closed = _closed_form(others, common)
    intrinsics, influence = _refined(others, closed.intrinsics)
    covariance, spread = _noise_covariance(others, influence, common), influence.jackknife_std
    by_noise = np.sqrt(np.diagonal(covariance))
    std = honest_std(by_noise, spread)
    camera = VirtualCamera(
        fitted.map,
        PlaneChart(intrinsics, covariance * np.outer(std / by_noise, std / by_noise)),
        intrinsics,
        Domain(hull),
        corner_set.image_size,
        fitted.noise,
        mirrored,
    )
    details: dict[str, object] = {
        "singular_values": [float(s) for s in closed.singular_values],
        "spread_of_k_over_subsets": None if spread is None else [float(s) for s in spread],
        "log_evidence": dict(fitted.candidates),
    }
    return Calibration(
        camera,
        corner_set,
        "one-image",
        kernel,
        fitted.trend,
        view.name,
        std,
        square_mm,
        closed.intrinsics,
        details=details,
    )


def reference_view(corner_set: CornerSet, name: str | None) -> Corners:
    """The view called ``name`` (whole, or its last part), or the one whose board covers most of the frame.

    Raises CalibrationError when no board was found at all or the chosen view shows too few corners, InputError when
    no view or two views are called so.
    """
    return reference_views(corner_set, name)[0]


def reference_views(corner_set: CornerSet, name: str | None) -> list[Corners]:
    """The :func:`reference_view` and, unless it was named, the views that can stand in for it, best first."""
    if not corner_set.found:
        raise CalibrationError(
            f"no {corner_set.board.spec} board was found in any of the {len(corner_set.views)} images: "
            f"check the board's size ({corner_set.board.counted}) and that it is sharp and wholly visible"
        )
    named = [] if name is None else [_named(corner_set, name)]
    best, *others = named or sorted(corner_set.found, key=coverage, reverse=True)
    if len(best) < MINIMUM_REFERENCE_CORNERS:
        raise CalibrationError(
            f"the reference '{best.name}' shows {len(best)} corners of the board and at least "
            f"{MINIMUM_REFERENCE_CORNERS} are needed: choose a photograph in which the board fills the frame"
        )
    return [best, *(view for view in others if len(view) >= MINIMUM_REFERENCE_CORNERS)]


def coverage(view: Corners) -> float:
    """How much of the frame a board covers, in px²; a board seen in part counts only as much as is seen of it."""
    return convex_hull(view.uv).area * len(view)


def _named(corner_set: CornerSet, name: str) -> Corners:
    whole = [v for v in corner_set.views if v.name == name]
    matches = whole or [v for v in corner_set.views if v.name.rsplit("/", 1)[-1] == name.rsplit("/", 1)[-1]]
    if len(matches) != 1:
        raise InputError(
            f"the reference '{name}' names {len(matches) or 'none'} of the {len(corner_set.views)} images: "
            "give the name of exactly one, as it stands in the list of images"
        )
    return matches[0]


def check_handedness(fitted: FittedMap, view: Corners, mirrored: bool) -> None:
    """Raise InputError when the reference board's numbering is of the other handedness than ``mirrored`` says."""
    determinant = np.median(np.linalg.det(fitted.map.jacobian(view.uv)))
    if (determinant < 0) != mirrored:
        found, needed = ("left", "right") if determinant < 0 else ("right", "left")
        remedy = "leave --mirrored out" if mirrored else "say --mirrored if the camera looks into a mirror"
        raise InputError(
            f"the corners of the reference '{view.name}' are numbered {found}-handed as seen in the image and "
            f"{needed}-handed is expected: {remedy}, or number x to the right and y down"
        )


def _boards_beside_reference(
    corner_set: CornerSet, view: Corners, fitted: FittedMap, hull: ConvexRegion
) -> list[MappedBoard]:
    inside: list[Bools] = [hull.contains(v.uv) for v in corner_set.views]
    mapped = map_boards(corner_set, fitted.map, inside)
    others = [b for b in mapped if b.used and b.name != view.name]
    if len(others) < 2:
        raise DegenerateError(
            f"beside the reference '{view.name}' {len(corner_set.found) - 1} images show the board, {len(others)} of "
            "them with at least 90 % of its corners inside the reference board's outline; two or more are needed to "
            "determine f, uc and vc: add photographs of the tilted board, or choose a reference in which it fills more "
            "of the frame"
        )
    return others


def _refined(boards: list[MappedBoard], intrinsics: Intrinsics) -> tuple[Intrinsics, Influence]:
    sightings = [Sighting(b.lattice, b.xy, b.whitening) for b in boards]
    found = refine_intrinsics(sightings, intrinsics, [pose_from_homography(b.homography, intrinsics) for b in boards])
    return found.intrinsics, influence_on_intrinsics(sightings, found.intrinsics, found.poses)


def honest_std(by_noise: Floats, spread: Floats | None) -> Floats:
    """What the corners' noise alone makes of K's std (3,), unless the boards disagree by clearly more than that.

    Then something no noise explains is at work (bent boards, a camera without one centre), and their spread counts.
    """
    return by_noise if spread is None else np.where(spread > DISAGREEMENT * by_noise, spread, by_noise)


def check_determined(camera: VirtualCamera, corner_set: CornerSet, reference: str) -> None:
    """Raise DegenerateError where the boards, as ``camera`` sees them, do not determine f, uc and vc.

    For a camera that was found in another way than by :func:`calibrate_one_image`. A camera so wide that fewer than two
    boards can be seen in one plane is let pass.
    """
    everywhere = replace(camera, domain=Domain(camera.domain.hull))
    others = [b for b in map_views(everywhere, corner_set) if b.used and b.name != reference]
    if len(others) < 2:
        return
    _closed_form(others, [np.zeros((DRAWS, 2 * len(b.uv))) for b in others])


def _closed_form(boards: list[MappedBoard], common: list[Floats]) -> ClosedForm:
    """The simplified Zhang's K; raises DegenerateError where noise alone, of which :func:`_common_shifts` says what all
    boards have in ``common``, could have made it.
    """
    homographies = np.stack([b.homography for b in boards])
    plane = normalising_similarity(np.concatenate([b.xy for b in boards]))
    closed = simplified_zhang(homographies, plane)
    values, _, valid = solve(_homographies_of_new_noise(boards, homographies, common), plane)
    std = float(values[valid, 0].std(ddof=1)) if valid.mean() > 0.9 else np.inf
    if not std < LARGEST_RELATIVE_STD * closed.intrinsics.f:
        raise DegenerateError(
            f"the {len(boards)} boards beside the reference do not determine f, uc and vc (f = "
            f"{closed.intrinsics.f:.3g} ± {std:.2g} squares, singular values {listed(closed.singular_values)}): "
            f"{TILT_MORE}"
        )
    return closed


def _homographies_of_new_noise(
    boards: list[MappedBoard], homographies: Floats, common: list[Floats]
) -> Floats:
    """Draws (DRAWS, boards, 3, 3) of what ``homographies`` become with new noise on all corners, to first order.

    The reference's corners have the noise that the fit of the map found, which moves all boards together: ``common``;
    each other board's what its homography left, which also holds what no map explains.
    """
    rng = np.random.default_rng(1)
    drawn = np.empty((DRAWS, *homographies.shape))
    for i, (board, px) in enumerate(zip(boards, common, strict=True)):
        by_px = _by_px(homography_response(board.homography, board.lattice, board.whitening), board)
        own = by_px.T * board.misfit_px / np.sqrt(2.0)
        moved = rng.standard_normal((DRAWS, 9)) @ np.linalg.qr(own, mode="r") + px @ by_px.T
        drawn[:, i] = board.homography + moved.reshape(DRAWS, 3, 3)
    return drawn


def _common_shifts(boards: list[MappedBoard], fitted: FittedMap) -> list[Floats]:
    """Draws (DRAWS, 2n) a board of how new noise of the reference's corners moves its corners, px times weights."""
    uv, whitening = np.concatenate([b.uv for b in boards]), np.concatenate([b.whitening for b in boards])
    shifts = fitted.map.noise_response(uv, DRAWS, np.random.default_rng(0))
    ends = np.cumsum([2 * len(b.uv) for b in boards])
    return np.split((whitening @ shifts[:, :, :, None]).reshape(DRAWS, -1), ends[:-1], axis=1)


def _by_px(response: Floats, board: MappedBoard) -> Floats:
    """∂/∂(the corners in px, times weights) (p, 2n) of what responds by ``response`` (p, 2n) to its virtual points."""
    by_point = response.reshape(len(response), -1, 2).transpose(1, 0, 2) @ np.linalg.inv(board.whitening)
    return np.asarray(by_point.transpose(1, 0, 2).reshape(len(response), -1))


def _noise_covariance(boards: list[MappedBoard], influence: Influence, common: list[Floats]) -> Floats:
    """Covariance (3, 3) of the refined f, uc, vc by the noise of :func:`_homographies_of_new_noise`."""
    own, together = np.zeros((3, 3)), np.zeros((DRAWS, 3))
    for board, response, px in zip(boards, influence.responses, common, strict=True):
        own += board.misfit_px**2 / 2.0 * response @ response.T
        together += px @ response.T
    return np.asarray(own + np.cov(together, rowvar=False))


__all__ = ["calibrate_one_image", "check_determined", "check_handedness", "reference_views"]
