"""What cannot be known: hidden by structure, or not shown by these data."""

from typing import ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers


class UnseenSection:
    """Parameters that no motion shows, and those that these motions do not show."""

    name: ClassVar[str] = "unseen"
    title: ClassVar[str] = "What could not be seen"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Names, and what each is tied to."""
        if content.identified is None:
            return None
        base = content.identified.base
        return {
            "hidden": [base.names[k] for k in base.unseen],
            "grouped": [base.names[k] for k in base.dependent],
            "standard": len(base.names),
            "base": len(base),
            "blind": content.identified.estimate.blind,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("unseen.html", numbers)
