"""Trends of the joint solve: parametric cameras, by the names that users give.

A new family is one file and one line here.
"""

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
"""Family → a function of the order that returns its searches; None stands for all orders."""

LAST_RESORT = ("polynomial",)
"""Families that are tried only where no trend of the others suffices without the process."""


NUMERALS = tuple("0123456789")


def searches_named(name: str) -> list[list[Search]]:
    """The searches for ``name`` in stages: all families for ``auto``, one for ``plane``, one order for ``plane:3``.

    Families of last resort are a stage of their own. Raises InputError, listing the known names, for any other name.
    """
    if name == "auto":
        first = [search for family, build in FAMILIES.items() if family not in LAST_RESORT for search in build(None)]
        return [first, [search for family in LAST_RESORT for search in FAMILIES[family](None)]]
    family, colon, order = name.partition(":")
    numerals = NUMERALS[1:] if family in LAST_RESORT else NUMERALS
    if family not in FAMILIES or (colon and order not in numerals):
        raise InputError(
            f"the joint refinement has no trend '{name}': choose one of auto, {', '.join(FAMILIES)}; "
            "an order from 0 to 9 may follow, for polynomial from 1, as in plane:3"
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
