"""Drive gains that were identified, and the payload that fixed their scale."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.estimation.payload.gains import DriveGain, GainEstimate
from steelyard.report.content import ReportContent
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import significant

if TYPE_CHECKING:
    from rich.console import RenderableType


ASSUMED = "assumed: geometric mean of the others"
"""Origin of a gain that the data do not identify."""


class DrivesSection(TableSection):
    """Gains with intervals."""

    name: ClassVar[str] = "drives"
    title: ClassVar[str] = "Drive gains"

    in_terminal: ClassVar[bool] = True

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if gains were identified."""
        return [] if content.gains is None else [_gains(content.gains)]

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The gains in one line."""
        from rich.text import Text

        if content.gains is not None:
            each = content.gains.each
            heading = "drive gains (± 95 %)" if any(map(_has_interval, each)) else "drive gains"
            yield Text(f"{heading}: {', '.join(map(_words, each))}")

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The gains."""
        return {"gains": None if content.gains is None else content.gains.to_dict()}


def _gains(gains: GainEstimate) -> PlainTable:
    intervals = any(map(_has_interval, gains.each))
    words = f"Joint effort per logged unit{', with 95 % intervals' if intervals else ''}."
    if gains.payload is not None:
        words += f" The payload of {significant(gains.payload.mass)} kg fixes their scale."
    rows = [
        Row((joint, significant(gain), _how(known, assumed, half), unit))
        for joint, gain, half, unit, known, assumed in gains.each
    ]
    how = "95 % interval" if intervals else "Origin"
    return PlainTable("", words, ("Joint", "Gain", how, "Unit"), rows, (0, 3))


def _has_interval(gain: DriveGain) -> bool:
    return not (gain.known or gain.assumed)


def _words(gain: DriveGain) -> str:
    """Like `elbow 9.97 ± 0.17 Nm/A`, or where the gain is from instead of its interval."""
    value = f"{gain.joint} {significant(gain.gain)}"
    if not _has_interval(gain):
        return f"{value} {gain.unit} ({'given' if gain.known else ASSUMED})"
    return f"{value} ± {significant(gain.half_width, 2)} {gain.unit}"


def _how(known: bool, assumed: bool, half: float) -> str:
    if assumed:
        return f"{ASSUMED}, not identifiable"
    return "given" if known else f"± {significant(half)}"
