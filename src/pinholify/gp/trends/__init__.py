"""Parametric trends of a map of the plane, by the names that users give. A new family is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable

from pinholify.errors import InputError
from pinholify.gp.trends.base import Trend
from pinholify.gp.trends.homography import Homography
from pinholify.gp.trends.lens import Lens
from pinholify.gp.trends.polynomial import Polynomial

NO_ORDERS = (0,)
NUMERALS = tuple("123456789")

TRENDS: dict[str, tuple[Callable[[int], Trend], tuple[int, ...]]] = {
    "homography": (lambda _: Homography(), NO_ORDERS),
    "lens": (Lens, (1, 2, 3, 4, 5, 6)),
    "polynomial": (Polynomial, (3, 5)),
}
"""Family → its constructor by order, and the orders tried where none is given."""


def trends_named(name: str) -> list[Trend]:
    """The trends to try for ``name``: all for ``auto``, a family's orders for ``lens``, exactly one for ``lens:3``.

    Raises InputError, listing the known names, for any other.
    """
    if name == "auto":
        return [build(order) for build, orders in TRENDS.values() for order in orders]
    family, colon, order = name.partition(":")
    build, orders = TRENDS.get(family, (None, ()))
    if build is None or (colon and (orders == NO_ORDERS or order not in NUMERALS)):
        raise InputError(
            f"unknown trend '{name}': choose one of auto, constant, {', '.join(TRENDS)}; "
            "an order from 1 to 9 may follow lens or polynomial, as in lens:3"
        )
    return [build(n) for n in ([int(order)] if colon else orders)]


__all__ = ["TRENDS", "Homography", "Lens", "Polynomial", "Trend", "trends_named"]
