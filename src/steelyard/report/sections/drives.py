"""Drive gains that were identified, and the payload that fixed their scale."""

from typing import ClassVar

from steelyard.estimation.payload.gains import GainEstimate
from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import significant


class DrivesSection:
    """Gains with intervals."""

    name: ClassVar[str] = "drives"
    title: ClassVar[str] = "Drive gains"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """One table, if gains were identified."""
        if content.gains is None:
            return None
        return {"tables": [_gains(content.gains)], "title": self.title}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("tables.html", numbers)


def _gains(gains: GainEstimate) -> PlainTable:
    words = "Joint effort per logged unit, with 95 % intervals."
    if gains.payload is not None:
        words += f" The payload of {significant(gains.payload.mass)} kg fixes their scale."
    rows = [
        Row((joint, significant(gain), _how(known, assumed, half), unit))
        for joint, gain, half, unit, known, assumed in gains.each
    ]
    return PlainTable("", words, ("Joint", "Gain", "95 % interval", "Unit"), rows, (0, 3))


def _how(known: bool, assumed: bool, half: float) -> str:
    if assumed:
        return "assumed: not identifiable, mean of the others"
    return "given" if known else f"± {significant(half)}"
