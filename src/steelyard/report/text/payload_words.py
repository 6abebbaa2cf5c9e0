"""Masses with their intervals, and numbers of changes, in words."""

from math import floor, isfinite, log10


def rounded(value: float, half: float) -> tuple[str, str]:
    """A value and its half-width, to two digits of the half-width; the latter empty without."""
    if not (isfinite(value) and isfinite(half)):
        return "not identifiable", ""
    digits = min(12, max(0, 1 - floor(log10(half)))) if half > 0.0 else 6
    return f"{value:.{digits}f}", f"{half:.{digits}f}"


def with_interval(value: float, half: float) -> str:
    """A value with the half-width of its interval."""
    number, width = rounded(value, half)
    return f"{number} ± {width}" if width else number


def counted_changes(count: int) -> str:
    """How many changes of the payload there are."""
    return f"{count} change{'s' * (count > 1)} of the payload" if count else "no change of payload"
