"""Wrong corners: those that the joint refinement rejected as gross errors.

They carry no information about a camera, so every measure of every method leaves them out, but never silently: what a
bad camera cannot explain must not pass for wrong corners.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import bdtrc

from pinholify.arrays import Bools
from pinholify.calibration.result import Calibration
from pinholify.corners import Corners, CornerSet, in_common

MANY = 0.02  # of all corners: more than a suitable detector gets wrong
TOO_MANY = 0.10  # half of the share of random gross errors that begins to affect the camera
UNLIKELY = 1e-4  # probability that any board has so many
NAMED = 8  # images listed in a sentence


@dataclass(frozen=True, slots=True, eq=False)
class WrongCorners:
    """``masks`` (n,) of the wrong corners of each view that has any, of ``found`` corners in all."""

    masks: Mapping[str, Bools]
    found: int

    @property
    def counts(self) -> dict[str, int]:
        """The number of wrong corners by image, the worst first."""
        counted = {name: int(mask.sum()) for name, mask in self.masks.items()}
        return dict(sorted(counted.items(), key=lambda each: -each[1]))

    @property
    def count(self) -> int:
        """The number of wrong corners."""
        return sum(self.counts.values())

    @property
    def share(self) -> float:
        """The fraction of all corners that are wrong."""
        return self.count / max(self.found, 1)

    @property
    def crowded(self) -> tuple[str, ...]:
        """Images with too many wrong corners, and significantly more than the other images."""
        return tuple(name for name in self.counts if self._crowds(self.masks[name]))

    def _crowds(self, mask: Bools) -> bool:
        count, size = int(mask.sum()), len(mask)
        elsewhere = (self.count - count + 1) / max(self.found - size + 1, 1)  # Laplace's rule of succession
        chance = float(bdtrc(count - 1, size, min(elsewhere, 1.0)))
        return count > TOO_MANY * size and chance * len(self.masks) < UNLIKELY

    def belonging(self, view: Corners) -> Bools:
        """Mask (n,) of the corners of ``view`` that are not wrong."""
        mask = self.masks.get(view.name)
        return np.ones(len(view), dtype=bool) if mask is None else ~mask

    def left_out_of(self, corner_set: CornerSet) -> CornerSet:
        """``corner_set`` without the wrong corners."""
        return corner_set.with_views(view.select(self.belonging(view)) for view in corner_set.views)


def wrong_corners(calibration: Calibration, corner_set: CornerSet) -> WrongCorners:
    """The corners of ``corner_set`` that the fit of ``calibration`` rejected as grossly wrong.

    There are none in photographs that it was not made from, nor for a method that rejects no corners.
    """
    named = calibration.findings.wrong_corners
    known = {view.name: own for view in corner_set.found if (own := calibration.known(view)) and own.name in named}
    masks = {
        view.name: np.isin(view.ids, named[known[view.name].name]) & in_common(view, known[view.name])
        for view in corner_set.found
        if view.name in known
    }
    return WrongCorners(masks, sum(len(view) for view in corner_set.found))


def sentences(wrong: WrongCorners) -> tuple[str, ...]:
    """How many corners were left out, of which images, and what it means if they are many; empty if there are none."""
    return tuple(f"{clause}." for clause in (_counted(wrong), _meaning(wrong)) if clause)


def _counted(wrong: WrongCorners) -> str:
    if not wrong.count:
        return ""
    verbs = ("is", "was") if wrong.count == 1 else ("are", "were")
    each = [f"{name} {count}" for name, count in wrong.counts.items()]
    more = f" and {len(each) - NAMED} more images" if len(each) > NAMED else ""
    return (
        f"{wrong.count} of {wrong.found} corners {verbs[0]} wrong and {verbs[1]} left out of every number: "
        f"{', '.join(each[:NAMED])}{more}"
    )


def _meaning(wrong: WrongCorners) -> str:
    if wrong.share > TOO_MANY:
        return (
            f"That is {100 * wrong.share:.0f} %, too many to be wrong corners alone: either the table or the detection "
            "is bad, or the camera does not fit its own photographs"
        )
    if wrong.share > MANY:
        return (
            f"That is {100 * wrong.share:.1f} %, more than good detection gets wrong: check these photographs and the "
            "detector that found their corners"
        )
    return ""
