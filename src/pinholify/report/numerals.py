"""Numbers as people read them: with units, and with as many digits as they are known to."""

from __future__ import annotations

import math

NONE = "–"


def number(value: float | None, digits: int) -> str:
    """``value`` with ``digits`` decimals; a dash where there is none."""
    return NONE if value is None or not math.isfinite(value) else f"{value:.{digits}f}".replace("-", "−")


def px(value: float | None) -> str:
    """A length in px, to three significant digits."""
    if value is None or not math.isfinite(value):
        return NONE
    return f"{value:.{decimals(value, 2)}f} px" if value < 1000 else "over 1000 px"


def decimals(value: float, significant: int) -> int:
    """How many decimals show ``significant`` digits of ``value``."""
    return 0 if value == 0 else max(0, significant - 1 - math.floor(math.log10(abs(value))))


def percent(share: float | None) -> str:
    """A share as per cent, to two significant digits."""
    if share is None or not math.isfinite(share):
        return NONE
    return f"{100 * share:.{min(decimals(100 * share, 2), 4)}f} %"


def angle(degrees: float | None) -> str:
    """An angle in whole degrees."""
    return NONE if degrees is None or not math.isfinite(degrees) else f"{degrees:.0f}°"


def scientific(value: float) -> str:
    """A small unitless number, in ten-thousandths as the field quotes it."""
    return f"{number(value * 1e4, 2)} × 10⁻⁴"


def with_std(value: float, std: float) -> str:
    """``value`` ± ``std``, both to two significant digits of the latter."""
    if not std > 0 or not math.isfinite(std):
        return f"{number(value, 4)} ± unknown"
    digits = decimals(std, 2)
    return f"{number(value, digits)} ± {number(std, digits)}"
