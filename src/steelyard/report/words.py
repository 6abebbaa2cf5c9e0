"""Numbers as people read them; what is not a number never breaks a page."""

from math import floor, isfinite, log10

NONE = "–"
"""Stands where there is no number."""


def significant(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits, never in the form `1e+03` below a million."""
    if value is None or not isfinite(value):
        return NONE if value is None or value != value else "inf" if value > 0 else "-inf"
    if value == 0.0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    return f"{value:,.{_decimals(value, digits)}f}".replace(",", "\u00a0")


def percent(value: float | None) -> str:
    """A percentage with its sign, like `5.4 %`."""
    text = significant(value, 2 if value is not None and abs(value) < 10.0 else 3)
    return text if text == NONE else f"{text}\u00a0%"


def alike(value: float, scale: float, digits: int = 2) -> str:
    """A number with the decimals that its uncertainty `scale` has at so many digits."""
    if not (isfinite(value) and isfinite(scale)) or scale <= 0.0:
        return significant(value, 4)
    if not (1e-6 <= scale < 1e6 and abs(value) < 1e9):
        return significant(value, 4)
    return f"{value:.{_decimals(scale, digits)}f}"


def count(number: int, thing: str) -> str:
    """Like `1 joint`, `6 joints`."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


def _decimals(value: float, digits: int) -> int:
    return max(digits - 1 - floor(log10(abs(value))), 0)
