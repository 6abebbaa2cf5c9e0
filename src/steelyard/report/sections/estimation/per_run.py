"""Parameters that every run has for itself."""

from collections.abc import Sequence
from typing import Any, ClassVar

from steelyard.estimation.estimate import RunParameters
from steelyard.report.content import ReportContent
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import significant


class PerRunSection(TableSection):
    """One column a run."""

    name: ClassVar[str] = "per-run"
    title: ClassVar[str] = "Parameters per run"

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if there are such parameters."""
        runs = _runs(content)
        if not runs:
            return []
        names = list(dict.fromkeys(name for own in runs for name in own.parameters.names))
        found = [own.parameters.as_dict() for own in runs]
        rows = [Row((name, *(significant(known.get(name)) for known in found))) for name in names]
        words = (
            "Estimated separately for every run; for a new run the model uses their mean, with the "
            "spread between runs as its uncertainty."
        )
        return [PlainTable("", words, ("Parameter", *(own.run for own in runs)), rows)]

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The parameters of every run."""
        return {"per_run": [{"run": own.run, **own.parameters.as_dict()} for own in _runs(content)]}


def _runs(content: ReportContent) -> Sequence[RunParameters]:
    return () if content.identified is None else content.identified.estimate.per_run
