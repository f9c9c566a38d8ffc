"""The choice of the reference: the board whose lattice becomes the virtual plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinholify.calibration.numbering import wrong_handedness
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CalibrationError, InputError
from pinholify.geometry import convex_hull

if TYPE_CHECKING:  # loads SciPy's optimisers, which the joint method does without
    from pinholify.gp.fitting import FittedMap

MINIMUM_REFERENCE_CORNERS = 16


def reference_view(corner_set: CornerSet, name: str | None) -> Corners:
    """The view called ``name`` (its whole path or its file name), or the one whose board covers most of the frame.

    Raises CalibrationError where no board was found at all or the chosen view shows too few corners, and InputError
    where ``name`` does not name exactly one view.
    """
    return reference_views(corner_set, name)[0]


def reference_views(corner_set: CornerSet, name: str | None) -> list[Corners]:
    """The :func:`reference_view` and, unless it was named, the views that can stand in for it, best first."""
    if not corner_set.found:
        raise CalibrationError(
            f"no {corner_set.board.spec} board was found in any of the {len(corner_set.views)} images: "
            f"check the board's size ({corner_set.board.counted}) and that the board is sharp and wholly visible"
        )
    named = [] if name is None else [_named(corner_set, name)]
    best, *others = named or sorted(corner_set.found, key=coverage, reverse=True)
    if len(best) < MINIMUM_REFERENCE_CORNERS:
        raise CalibrationError(
            f"the reference '{best.name}' shows {len(best)} corners of the board, but at least "
            f"{MINIMUM_REFERENCE_CORNERS} are needed: choose a photograph in which the board fills the frame"
        )
    return [best, *(view for view in others if len(view) >= MINIMUM_REFERENCE_CORNERS)]


def coverage(view: Corners) -> float:
    """A score of how much of the frame a board covers: the area of its hull in px² times its number of corners."""
    return convex_hull(view.uv).area * len(view)


def _named(corner_set: CornerSet, name: str) -> Corners:
    whole = [v for v in corner_set.views if v.name == name]
    matches = whole or [v for v in corner_set.views if v.name.rsplit("/", 1)[-1] == name.rsplit("/", 1)[-1]]
    if len(matches) != 1:
        raise InputError(
            f"the reference must be one of the {len(corner_set.views)} images, but '{name}' is the name of "
            f"{len(matches) or 'none'} of them: give a name as in the list of images"
        )
    return matches[0]


def check_handedness(fitted: FittedMap, view: Corners, mirrored: bool) -> None:
    """Raise InputError where the numbering of the reference board does not have the handedness for ``mirrored``."""
    determinant = np.median(np.linalg.det(fitted.map.jacobian(view.uv)))
    if (determinant < 0) != mirrored:
        raise wrong_handedness(f"the corners of the reference '{view.name}'", mirrored)
