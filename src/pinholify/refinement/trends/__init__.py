"""Trends of the joint solve by the name a user gives. A new family is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from pinholify.errors import InputError
from pinholify.refinement.trends.base import Angles, Plane, RayChart, Search, Trend
from pinholify.refinement.trends.polynomial import PolynomialTrend, polynomial_searches
from pinholify.refinement.trends.radial import LensTrend, lens_searches

FAMILIES: dict[str, Callable[[int | None], list[Search]]] = {
    "plane": partial(lens_searches, Plane(), False),
    "angle": partial(lens_searches, Angles(), False),
    "plane-d": partial(lens_searches, Plane(), True),
    "angle-d": partial(lens_searches, Angles(), True),
    "polynomial": polynomial_searches,
}
"""Family → its searches, of all orders or of a given one."""

LAST_RESORT = ("polynomial",)
"""Families that are solved only where no other suffices without the process."""


def searches_named(name: str) -> list[list[Search]]:
    """The searches for ``name``, those of last resort apart: ``auto`` all, ``plane`` a family's, ``plane:3``
    one order's.

    Raises InputError with the names there are.
    """
    if name == "auto":
        first = [search for family, build in FAMILIES.items() if family not in LAST_RESORT for search in build(None)]
        return [first, [search for family in LAST_RESORT for search in FAMILIES[family](None)]]
    family, colon, order = name.partition(":")
    if family not in FAMILIES or (colon and not (order.isdigit() and int(order) <= 9)):
        raise InputError(
            f"'{name}' is no trend of the joint refinement; they are: auto, {', '.join(FAMILIES)}, "
            "and an order up to 9 may follow, as in plane:3"
        )
    return [FAMILIES[family](int(order) if colon else None)]


__all__ = [
    "FAMILIES",
    "Angles",
    "LensTrend",
    "Plane",
    "PolynomialTrend",
    "RayChart",
    "Search",
    "Trend",
    "searches_named",
]
