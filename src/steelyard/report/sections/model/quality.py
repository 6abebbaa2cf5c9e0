"""What was found in the logs."""

from typing import ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section

LONG = 80
"""Letters from which on a value stands below its run, over the whole width."""


class QualitySection(Section):
    """Rows, rates, gaps and dropped samples of every run."""

    name: ClassVar[str] = "quality"
    title: ClassVar[str] = "Data quality"
    folded: ClassVar[bool] = True

    def numbers(self, content: ReportContent) -> Numbers | None:
        """One column per label, one row per run; what is long stands below its run.

        Runs may have different labels.
        """
        if not content.qualities:
            return None
        values = [value for _, found in content.qualities for value in found]
        long = dict.fromkeys(label for label, value in values if len(value) > LONG)
        labels = [
            label for label in dict.fromkeys(label for label, _ in values) if label not in long
        ]
        return {
            "labels": labels,
            "runs": [
                (
                    run,
                    [dict(found).get(label, "") for label in labels],
                    [(label, value) for label, value in found if label in long],
                )
                for run, found in content.qualities
            ],
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("quality.html", numbers)
