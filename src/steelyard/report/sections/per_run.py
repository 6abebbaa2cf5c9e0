"""Parameters that every run has for itself."""

from typing import ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import significant


class PerRunSection:
    """One column a run."""

    name: ClassVar[str] = "per-run"
    title: ClassVar[str] = "Parameters of single runs"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """One table, if there are such parameters."""
        if content.identified is None or not content.identified.estimate.per_run:
            return None
        runs = content.identified.estimate.per_run
        names = list(dict.fromkeys(name for own in runs for name in own.parameters.names))
        found = [own.parameters.as_dict() for own in runs]
        rows = [Row((name, *(significant(known.get(name)) for known in found))) for name in names]
        words = (
            "Every run has these for itself; for a new run the model takes their mean, with the "
            "spread between runs as its uncertainty."
        )
        table = PlainTable("", words, ("Parameter", *(own.run for own in runs)), rows)
        return {"tables": [table], "title": self.title}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("tables.html", numbers)
