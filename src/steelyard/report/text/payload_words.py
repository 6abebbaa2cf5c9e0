"""Masses with their intervals, and numbers of changes, in words."""

from __future__ import annotations

from math import floor, isfinite, log10
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from steelyard.application.payload_events import PayloadEvents


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


def counted_changes(found: PayloadEvents) -> str:
    """How many changes of the payload there are, or which would be seen."""
    count, least = len(found.events), f"{found.least_mass:.2g} kg"
    if count:
        return f"{count} change{'s' * (count > 1)} of the payload"
    if found.conclusive:
        return f"no change of payload by {least} or more"
    return (
        f"cannot tell whether the payload changes: one by less than {least} would not be seen; the "
        "model does not describe this log (steelyard check names what differs)"
    )
