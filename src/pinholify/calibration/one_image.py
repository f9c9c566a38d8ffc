"""The paper's method: one image makes the map, and the others only find f, uc and vc.

The reference board's corners, as a map from pixels to its lattice, define the virtual plane
(:mod:`pinholify.gp.fitting`). The other boards, seen in that plane, are boards seen by a perfect pinhole camera: their
homographies give K (:mod:`pinholify.calibration.intrinsics`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from pinholify.arrays import Bools
from pinholify.calibration.condensing import block_side, condensed, condensed_view
from pinholify.calibration.intrinsics import find_intrinsics
from pinholify.calibration.methods import FEWEST_BOARDS
from pinholify.calibration.observation import MINIMUM_SHARE_INSIDE, MappedBoard, map_boards
from pinholify.calibration.reference import check_handedness, reference_view
from pinholify.calibration.result import Calibration
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import PlaneChart
from pinholify.corners import Corners, CornerSet
from pinholify.errors import DegenerateError
from pinholify.geometry import ConvexRegion, convex_hull

if TYPE_CHECKING:
    from pinholify.gp.fitting import FittedMap

MAX_MAP_POINTS = 600  # of the reference board; a denser one is condensed, because the process costs n³
MAX_CORNERS = 12_000  # of all boards, for f, uc and vc


def calibrate_one_image(
    corner_set: CornerSet,
    *,
    reference: str | None = None,
    kernel: str = "se",
    trend: str = "auto",
    mirrored: bool = False,
    square_mm: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Calibration:
    """The virtual camera learnt from one board, with K refined from the others (paper, section 2.2).

    ``reference`` names the board that the map is learnt from, by default the one that covers most of the frame.
    ``kernel`` and ``trend`` are names of the registries in :mod:`pinholify.gp`; ``mirrored`` says that the images are
    reflections; ``square_mm`` is the side of a square; ``progress`` is called with one line per stage. Raises
    InputError for a reference that is missing or numbered with the wrong handedness, CalibrationError where too little
    of it is seen, and DegenerateError where the boards do not determine K.
    """
    from pinholify.gp.fitting import fit_map

    say = progress or (lambda _: None)
    view = reference_view(corner_set, reference)
    learnt = condensed_view(view, corner_set.board, block_side(len(view), MAX_MAP_POINTS))
    lattice = learnt.lattice(corner_set.board)
    fitted = fit_map(learnt.uv, lattice, kernel=kernel, trend=trend, relative_noise=1.0 / learnt.weights)
    check_handedness(fitted, view, mirrored)
    say(f"map from the board in '{view.name}': noise {fitted.noise:.4g} px with trend {fitted.trend}")
    hull = convex_hull(view.uv)
    found = find_intrinsics(_other_boards(condensed(corner_set, MAX_CORNERS), view, fitted, hull), fitted)
    say(f"f {found.intrinsics.f:.5g} ± {found.std[0]:.2g} squares from the other boards")
    camera = VirtualCamera(
        fitted.map,
        PlaneChart(found.intrinsics, found.covariance),
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


def _other_boards(corner_set: CornerSet, view: Corners, fitted: FittedMap, hull: ConvexRegion) -> list[MappedBoard]:
    """The used boards but for the reference ``view``; raises DegenerateError for fewer than two."""
    inside: list[Bools] = [hull.contains(v.uv) for v in corner_set.views]
    mapped = map_boards(corner_set, fitted.map, inside)
    others = [b for b in mapped if b.used and b.name != view.name]
    shown = len(corner_set.found)
    if shown < FEWEST_BOARDS:
        raise DegenerateError(
            f"the board was found in {shown} of the {len(corner_set.views)} images, but {FEWEST_BOARDS} or more are "
            "needed to determine f, uc and vc: add photographs of the board tilted in different directions"
        )
    if len(others) < 2:
        raise DegenerateError(
            f"besides the reference '{view.name}', {shown - 1} images show the board, {len(others)} of "
            f"them with at least {100 * MINIMUM_SHARE_INSIDE:g} % of its corners inside the reference board's outline, "
            "but two or more are needed to determine f, uc and vc: add photographs of the tilted board, or choose a "
            "reference in which it fills more of the frame"
        )
    return others
