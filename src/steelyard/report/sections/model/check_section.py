"""What the checks found in the logs before anything was identified, with the evidence."""

from typing import Any, ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.model.check import findings_of
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.text.findings import diagnosis_dict

FEW = 40_000
"""Most points of all pictures of the evidence together."""


class CheckSection(Section):
    """The verdict on the logs, and every finding; what is not ok with its picture."""

    name: ClassVar[str] = "check"
    title: ClassVar[str] = "Check of the logs"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The findings, if the logs were checked."""
        if content.diagnosis is None:
            return None
        return findings_of(content.diagnosis, FEW, fine=False)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The findings."""
        return {"check": None if content.diagnosis is None else diagnosis_dict(content.diagnosis)}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("findings.html", numbers)
