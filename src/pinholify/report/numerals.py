"""Numbers formatted for people: with units, and with as many digits as are significant."""

from __future__ import annotations

import math

NONE = "–"


def round_down(value: float) -> float:
    """The largest of …, 1, 2, 5, 10, … that is at most ``value`` > 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * max(m for m in (1.0, 2.0, 5.0) if m * power <= value * (1 + 1e-12))


def number(value: float | None, digits: int) -> str:
    """``value`` with ``digits`` decimals; a dash if there is none."""
    return NONE if value is None or not math.isfinite(value) else f"{value:.{digits}f}".replace("-", "−")


def px(value: float | None) -> str:
    """A length in px, to two significant digits."""
    if value is None or not math.isfinite(value):
        return NONE
    return f"{value:.{decimals(value, 2)}f} px" if value < 1000 else "over 1000 px"


def decimals(value: float, significant: int) -> int:
    """The number of decimals that show ``significant`` digits of ``value``."""
    return 0 if value == 0 else max(0, significant - 1 - math.floor(math.log10(abs(value))))


def percent(share: float | None) -> str:
    """A fraction in per cent, to two significant digits."""
    if share is None or not math.isfinite(share):
        return NONE
    return f"{100 * share:.{min(decimals(100 * share, 2), 4)}f} %"


def angle(degrees: float | None) -> str:
    """An angle in whole degrees."""
    return NONE if degrees is None or not math.isfinite(degrees) else f"{degrees:.0f}°"


def scientific(value: float) -> str:
    """A small unitless number in units of 10⁻⁴, as is usual for collinearity errors."""
    return f"{number(value * 1e4, 2)} × 10⁻⁴"


def with_std(value: float, std: float) -> str:
    """``value`` ± ``std``, both to two significant digits of ``std``."""
    if not std > 0 or not math.isfinite(std):
        return f"{number(value, 4)} ± unknown"
    digits = decimals(std, 2)
    return f"{number(value, digits)} ± {number(std, digits)}"
