"""How estimates from each log alone scatter, beside what was stated."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row, text_table
from steelyard.report.text.words import count, percent, significant

if TYPE_CHECKING:
    from rich.console import RenderableType

    from steelyard.estimation.repeated import RepeatedEstimates

TITLE = "Estimates from each log alone"


class RepeatedSection(TableSection):
    """Mean and standard deviation of every parameter over the logs."""

    name: ClassVar[str] = "repeated"
    title: ClassVar[str] = TITLE

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if it was asked for."""
        return [] if content.repeated is None else [repeated_table(content.repeated)]

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The estimates and their scatter."""
        return {"repeated": None if content.repeated is None else content.repeated.to_dict()}

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The table, as it was asked for."""
        for table in self.tables(content):
            yield text_table(table, self.title)


def repeated_table(found: RepeatedEstimates) -> PlainTable:
    """One row per parameter; a parameter that some estimations do not identify has their number."""
    every = len(found.labels)
    rows = [
        Row(
            (
                row["name"] + ("" if row["count"] == every else f" ({row['count']} of {every})"),
                *(significant(row[key]) for key in ("mean", "std")),
                percent(row["relative_percent"]),
                significant(row["stated_std"]),
                row["unit"],
            )
        )
        for row in found.rows()
    ]
    return PlainTable(
        f"{TITLE}: {count(every, 'estimation')}",
        f"Mean and {found.deviation} standard deviation over {', '.join(found.labels)}, beside the "
        "root mean square of the stated standard deviations. A prior that all estimations share "
        "reduces their scatter.",
        ("Parameter", "Mean", "Std", "Relative", "Stated std", "Unit"),
        rows,
        (0, 5),
        f"std: {found.deviation}; relative: over the mean; stated std: root mean square of those "
        "stated by the estimations",
    )
