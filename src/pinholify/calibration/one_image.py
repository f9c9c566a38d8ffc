"""The paper's method: one image makes the camera, further ones only find three numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pinholify.arrays import Bools
from pinholify.calibration.condensing import block_side, condensed, condensed_view
from pinholify.calibration.intrinsics import find_intrinsics
from pinholify.calibration.observation import MappedBoard, map_boards
from pinholify.calibration.reference import check_handedness, reference_view
from pinholify.calibration.result import Calibration
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import PlaneChart
from pinholify.corners import Corners, CornerSet
from pinholify.errors import DegenerateError
from pinholify.geometry import ConvexRegion, convex_hull

if TYPE_CHECKING:
    from pinholify.gp.fitting import FittedMap

MOST_POINTS = 600  # that the process learns from; denser ones are condensed: it takes n³
MOST_IN_ALL = 12_000  # corners of all boards


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
    check_handedness(fitted, view, mirrored)
    hull = convex_hull(view.uv)
    found = find_intrinsics(_boards_beside_reference(condensed(corner_set, MOST_IN_ALL), view, fitted, hull), fitted)
    camera = VirtualCamera(
        fitted.map,
        PlaneChart(found.intrinsics, found.covariance),
        found.intrinsics,
        Domain(hull),
        corner_set.image_size,
        fitted.noise,
        mirrored,
    )
    details: dict[str, object] = {
        "singular_values": [float(s) for s in found.closed_form.singular_values],
        "spread_of_k_over_subsets": None if found.spread is None else [float(s) for s in found.spread],
        "log_evidence": dict(fitted.candidates),
    }
    return Calibration(
        camera,
        corner_set,
        "one-image",
        kernel,
        fitted.trend,
        view.name,
        found.std,
        square_mm,
        found.closed_form.intrinsics,
        details=details,
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
