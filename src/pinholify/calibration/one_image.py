"""The paper's method: one image makes the camera, further ones only find three numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.calibration.condensing import block_side, condensed, condensed_view
from pinholify.calibration.observation import MappedBoard, map_boards, map_views
from pinholify.calibration.poses import Sighting, refine_intrinsics
from pinholify.calibration.result import Calibration
from pinholify.calibration.zhang import (
    TILT_MORE,
    ClosedForm,
    jackknife_std,
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
    """The virtual camera that one board makes, with K from the others in closed form (paper, section 2.2).

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
    homographies, plane = np.stack([b.homography for b in others]), _plane_normalisation(others)
    closed = simplified_zhang(homographies, plane)
    spread = jackknife_std(homographies, plane)
    std = honest_std(_noise_std(others, homographies, plane, fitted), spread)
    _check_std(std, closed, len(others))
    camera = VirtualCamera(
        fitted.map,
        PlaneChart(closed.intrinsics),
        closed.intrinsics,
        Domain(hull),
        corner_set.image_size,
        fitted.noise,
        mirrored,
    )
    refined = _refined(others, closed.intrinsics)
    details: dict[str, object] = {
        "singular_values": [float(s) for s in closed.singular_values],
        "spread_of_k_over_subsets": None if spread is None else [float(s) for s in spread],
        "log_evidence": dict(fitted.candidates),
    }
    return Calibration(
        camera, corner_set, "one-image", kernel, fitted.trend, view.name, std, refined, square_mm, details=details
    )


def reference_view(corner_set: CornerSet, name: str | None) -> Corners:
    """The view called ``name`` (whole, or its last part), or the one whose board covers most of the frame.

    Raises CalibrationError when no board was found at all or the chosen view shows too few corners, InputError when
    no view or two views are called so.
    """
    if not corner_set.found:
        raise CalibrationError(
            f"no {corner_set.board.spec} board was found in any of the {len(corner_set.views)} images: "
            f"check the board's size ({corner_set.board.counted}) and that it is sharp and wholly visible"
        )
    view = max(corner_set.found, key=coverage) if name is None else _named(corner_set, name)
    if len(view) < MINIMUM_REFERENCE_CORNERS:
        raise CalibrationError(
            f"the reference '{view.name}' shows {len(view)} corners of the board and at least "
            f"{MINIMUM_REFERENCE_CORNERS} are needed: choose a photograph in which the board fills the frame"
        )
    return view


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


def _plane_normalisation(boards: list[MappedBoard]) -> Floats:
    return normalising_similarity(np.concatenate([b.xy for b in boards]))


def _refined(boards: list[MappedBoard], intrinsics: Intrinsics) -> Intrinsics:
    sightings = [Sighting(b.lattice, b.xy, b.whitening) for b in boards]
    poses = [pose_from_homography(b.homography, intrinsics) for b in boards]
    return refine_intrinsics(sightings, intrinsics, poses).intrinsics


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
    homographies, plane = np.stack([b.homography for b in others]), _plane_normalisation(others)
    closed = simplified_zhang(homographies, plane)
    _check_std(_noise_std(others, homographies, plane, None), closed, len(others))


def _check_std(std: Floats, closed: ClosedForm, boards: int) -> None:
    if not std[0] < LARGEST_RELATIVE_STD * closed.intrinsics.f:
        raise DegenerateError(
            f"the {boards} boards beside the reference do not determine f, uc and vc (f = "
            f"{closed.intrinsics.f:.3g} ± {std[0]:.2g} squares, singular values "
            f"{listed(closed.singular_values)}): {TILT_MORE}"
        )


def _noise_std(
    boards: list[MappedBoard], homographies: Floats, plane: Floats, fitted: FittedMap | None
) -> Floats:
    """Standard deviations of f, uc, vc: new noise is drawn on all corners and followed to first order.

    The reference's corners get the noise that the fit of the map found (none without a ``fitted`` map), each other
    board's what its homography left, which also holds what no map explains.
    """
    rng = np.random.default_rng(0)
    uv = np.concatenate([b.uv for b in boards])
    shifts = np.zeros((DRAWS, 0, 2)) if fitted is None else fitted.map.noise_response(uv, DRAWS, rng)
    drawn = np.empty((DRAWS, *homographies.shape))
    ends = np.cumsum([len(b.uv) for b in boards])
    for i, (board, common) in enumerate(zip(boards, np.split(shifts, ends[:-1], axis=1), strict=True)):
        response = homography_response(board.homography, board.lattice, board.whitening)
        by_px = response.reshape(-1, len(board.uv), 2).transpose(1, 0, 2) @ np.linalg.inv(board.whitening)
        own = by_px.transpose(0, 2, 1).reshape(-1, len(response)) * board.misfit_px / np.sqrt(2.0)
        moved = rng.standard_normal((DRAWS, len(response))) @ np.linalg.qr(own, mode="r")  # as all corners' noise would
        if fitted is not None:
            moved += common.reshape(DRAWS, -1) @ response.T
        drawn[:, i] = board.homography + moved.reshape(DRAWS, 3, 3)
    values, _, valid = solve(drawn, plane)
    return np.full(3, np.inf) if valid.mean() < 0.9 else np.asarray(values[valid].std(axis=0, ddof=1))


__all__ = ["calibrate_one_image", "check_determined", "check_handedness", "reference_view"]
