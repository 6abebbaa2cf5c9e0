"""Additional motions, and what it would bring."""

from __future__ import annotations

from typing import ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.design_words import brings, helpful, instead


class DesignAdviceSection(Section):
    """Motions beside the designed one."""

    name: ClassVar[str] = "design-advice"
    title: ClassVar[str] = "Additional motions"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """What each of them would bring."""
        designed = content.design
        if designed is None or not designed.advice:
            return None
        rows = [
            Row(
                (
                    one.what,
                    f"{one.seconds:.3g} s",
                    f"{len(one.helps)} of {len(designed.shown.names)}",
                    brings(designed, one),
                    instead(designed, one),
                )
            )
            for one in helpful(designed.advice)
        ]
        headings = (
            "Additional motion",
            "Length",
            "Parameters improved",
            "Predicted std",
            "This motion, extended by the same time",
        )
        return {"tables": [PlainTable("", "", headings, rows, (0, 3))], "title": self.title}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("design_advice.html", numbers)
