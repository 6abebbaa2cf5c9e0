"""What was found in the logs."""

from typing import ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers


class QualitySection:
    """Rows, rates, gaps and dropped samples of every run."""

    name: ClassVar[str] = "quality"
    title: ClassVar[str] = "Data quality"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """One column per label, one row per run; runs may have different labels."""
        if not content.qualities:
            return None
        labels = dict.fromkeys(label for _, found in content.qualities for label, _ in found)
        return {
            "labels": list(labels),
            "runs": [
                (run, [dict(found).get(label, "") for label in labels])
                for run, found in content.qualities
            ],
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("quality.html", numbers)
