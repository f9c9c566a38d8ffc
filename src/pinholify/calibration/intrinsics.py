"""f, uc and vc of a virtual plane from the boards in it, with their error bars.

The paper takes them directly from the simplified Zhang's method. Here that closed form is only the start of a least
squares fit: on simulated boards its errors are two to three times as large. It is reported next to the result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pinholify.arrays import Floats
from pinholify.calibration.observation import MappedBoard, map_views
from pinholify.calibration.poses import Influence, Sighting, influence_on_intrinsics, refine_intrinsics
from pinholify.calibration.zhang import (
    TILT_MORE,
    ClosedForm,
    listed,
    pose_from_homography,
    simplified_zhang,
    solve,
)
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import Intrinsics
from pinholify.corners import CornerSet
from pinholify.errors import DegenerateError
from pinholify.geometry import homography_response, normalising_similarity

if TYPE_CHECKING:  # loads SciPy's optimisers, which the joint method does without
    from pinholify.gp.fitting import FittedMap

DRAWS = 200  # of the noise
LARGEST_RELATIVE_STD = 0.5  # of f: beyond it the boards do not determine it
DISAGREEMENT_RATIO = 2.0  # to the noise's std: a jackknife over unlike boards is itself up to 1.5 times too large


@dataclass(frozen=True, slots=True, eq=False)
class FoundIntrinsics:
    """f, uc and vc by least squares, in squares, and the closed form they started from.

    ``noise_covariance`` (3, 3) in squares² is due to the corners' noise alone; ``spread`` (3,) are the standard
    deviations found by leaving out one board at a time, None for fewer than four boards.
    """

    intrinsics: Intrinsics
    closed_form: ClosedForm
    noise_covariance: Floats
    spread: Floats | None

    @property
    def std(self) -> Floats:
        """Standard deviations (3,) of f, uc and vc, squares: due to noise, unless the boards disagree by clearly more.

        In that case noise does not explain the boards (they are bent, or the camera has no single centre), and their
        spread counts.
        """
        by_noise = np.sqrt(np.diagonal(self.noise_covariance))
        if self.spread is None:
            return np.asarray(by_noise)
        return np.where(self.spread > DISAGREEMENT_RATIO * by_noise, self.spread, by_noise)

    @property
    def covariance(self) -> Floats:
        """Covariance (3, 3) with the standard deviations of :attr:`std`."""
        widening = self.std / np.sqrt(np.diagonal(self.noise_covariance))
        return np.asarray(self.noise_covariance * np.outer(widening, widening))


def find_intrinsics(boards: list[MappedBoard], fitted: FittedMap) -> FoundIntrinsics:
    """f, uc and vc of the virtual plane of ``fitted`` from the ``boards`` in it, none of which is the reference.

    Raises DegenerateError where the boards do not determine them.
    """
    common = _common_shifts(boards, fitted)
    closed = _closed_form(boards, common)
    intrinsics, influence = _refined(boards, closed.intrinsics)
    covariance = _noise_covariance(boards, influence, common)
    return FoundIntrinsics(intrinsics, closed, covariance, influence.jackknife_std)


def check_determined(camera: VirtualCamera, corner_set: CornerSet, reference: str) -> None:
    """Raise DegenerateError where the boards, as ``camera`` sees them, do not determine f, uc and vc.

    This is the check for cameras that :func:`find_intrinsics` did not make. A camera so wide that fewer than two boards
    besides the ``reference`` can be seen in one plane passes.
    """
    everywhere = replace(camera, domain=Domain(camera.domain.hull))
    others = [b for b in map_views(everywhere, corner_set) if b.used and b.name != reference]
    if len(others) < 2:
        return
    _closed_form(others, [np.zeros((DRAWS, 2 * len(b.uv))) for b in others])


def _refined(boards: list[MappedBoard], intrinsics: Intrinsics) -> tuple[Intrinsics, Influence]:
    sightings = [Sighting(b.lattice, b.xy, b.whitening) for b in boards]
    found = refine_intrinsics(sightings, intrinsics, [pose_from_homography(b.homography, intrinsics) for b in boards])
    return found.intrinsics, influence_on_intrinsics(sightings, found.intrinsics, found.poses)


def _closed_form(boards: list[MappedBoard], common: list[Floats]) -> ClosedForm:
    """K by the simplified Zhang's method; raises DegenerateError where noise alone could have made it.

    ``common`` are the draws of noise that all boards share, from :func:`_common_shifts`.
    """
    homographies = np.stack([b.homography for b in boards])
    plane = normalising_similarity(np.concatenate([b.xy for b in boards]))
    closed = simplified_zhang(homographies, plane)
    values, _, valid = solve(_homographies_of_new_noise(boards, homographies, common), plane)
    std = float(values[valid, 0].std(ddof=1)) if valid.mean() > 0.9 else np.inf
    if not std < LARGEST_RELATIVE_STD * closed.intrinsics.f:
        raise DegenerateError(
            f"the {len(boards)} boards besides the reference do not determine f, uc and vc (f = "
            f"{closed.intrinsics.f:.3g} ± {std:.2g} squares, singular values {listed(closed.singular_values)}): "
            f"{TILT_MORE}"
        )
    return closed


def _homographies_of_new_noise(
    boards: list[MappedBoard], homographies: Floats, common: list[Floats]
) -> Floats:
    """Draws (DRAWS, boards, 3, 3) of the ``homographies`` with new noise on all corners, to first order.

    The reference's corners have the noise found by the fit of the map, which moves all boards together: ``common``. The
    corners of each other board have that of the homography's residuals, which include what no map explains.
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
    """Shifts (DRAWS, 2n) of each board's corners, px times weights, by new noise of the reference's corners."""
    uv, whitening = np.concatenate([b.uv for b in boards]), np.concatenate([b.whitening for b in boards])
    shifts = fitted.map.noise_response(uv, DRAWS, np.random.default_rng(0))
    ends = np.cumsum([2 * len(b.uv) for b in boards])
    return np.split((whitening @ shifts[:, :, :, None]).reshape(DRAWS, -1), ends[:-1], axis=1)


def _by_px(response: Floats, board: MappedBoard) -> Floats:
    """``response`` (p, 2n), a derivative by virtual points, as that by the board's corners in px, times weights."""
    by_point = response.reshape(len(response), -1, 2).transpose(1, 0, 2) @ np.linalg.inv(board.whitening)
    return np.asarray(by_point.transpose(1, 0, 2).reshape(len(response), -1))


def _noise_covariance(boards: list[MappedBoard], influence: Influence, common: list[Floats]) -> Floats:
    """Covariance (3, 3) of the refined f, uc, vc due to the noise of :func:`_homographies_of_new_noise`."""
    own, together = np.zeros((3, 3)), np.zeros((DRAWS, 3))
    for board, response, px in zip(boards, influence.responses, common, strict=True):
        own += board.misfit_px**2 / 2.0 * response @ response.T
        together += px @ response.T
    return np.asarray(own + np.cov(together, rowvar=False))
