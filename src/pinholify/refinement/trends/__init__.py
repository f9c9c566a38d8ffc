"""Trends of the joint solve by the name a user gives. A new family is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable

from pinholify.errors import InputError
from pinholify.refinement.trends.base import Angles, Plane, RayChart, Trend
from pinholify.refinement.trends.polynomial import PolynomialTrend
from pinholify.refinement.trends.radial import (
    LensTrend,
    angle_lens,
    angle_lens_distorting,
    plane_lens,
    plane_lens_distorting,
)

TRENDS: dict[str, tuple[Callable[[int], Trend], tuple[int, ...]]] = {
    "angle": (angle_lens, (1, 2, 3, 4, 5, 6)),
    "plane": (plane_lens, (0, 1, 2, 3, 4, 5, 6)),
    "angle-d": (angle_lens_distorting, (1, 2, 3, 4, 5, 6)),
    "plane-d": (plane_lens_distorting, (1, 2, 3, 4, 5, 6)),
    "polynomial": (PolynomialTrend, (3, 5, 7)),
}
"""Family → its constructor by order, and the orders tried when none is named."""


def families_named(name: str) -> dict[str, list[Trend]]:
    """The trends to try for ``name`` by family: ``auto`` all, ``plane`` a family's orders, ``plane:3`` just
    that one.

    Raises InputError with the names there are.
    """
    if name == "auto":
        return {family: [build(n) for n in orders] for family, (build, orders) in TRENDS.items()}
    family, colon, order = name.partition(":")
    if family not in TRENDS or (colon and not (order.isdigit() and int(order) <= 9)):
        raise InputError(
            f"'{name}' is no trend of the joint refinement; they are: auto, {', '.join(TRENDS)}, "
            "and an order up to 9 may follow, as in plane:3"
        )
    build, orders = TRENDS[family]
    return {family: [build(n) for n in ([int(order)] if colon else orders)]}


__all__ = ["TRENDS", "Angles", "LensTrend", "Plane", "PolynomialTrend", "RayChart", "Trend", "families_named"]
