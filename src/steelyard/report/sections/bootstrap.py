"""How the estimate scatters when windows of time are drawn again, beside what was stated."""

from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import significant

FAR = 2.0
"""Ratio of the two standard deviations from which on a row is marked."""


class BootstrapSection:
    """Stated and drawn standard deviations of every parameter."""

    name: ClassVar[str] = "bootstrap"
    title: ClassVar[str] = "Scatter over windows of time"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """One table, if it was asked for."""
        if content.bootstrap is None or content.identified is None:
            return None
        return {"tables": [scatter_table(content)], "title": self.title}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("tables.html", numbers)


def ratios(content: ReportContent) -> Array:
    """Scatter of each parameter over its stated standard deviation, shape `(p,)`."""
    if content.bootstrap is None or content.identified is None:
        raise ValueError("there is no bootstrap to show")
    stated = content.identified.estimate.std
    drawn = content.bootstrap.std
    return np.asarray(np.divide(drawn, stated, out=np.full(len(drawn), np.nan), where=stated > 0.0))


def scatter_table(content: ReportContent) -> PlainTable:
    """One row per parameter; those that scatter far more than was stated are marked."""
    found, identified = content.bootstrap, content.identified
    if found is None or identified is None:
        raise ValueError("there is no bootstrap to show")
    lower, upper = found.interval()
    own = found.parameters
    stated, drawn, over = identified.estimate.std, found.std, ratios(content)
    rows = []
    for k, (name, unit) in enumerate(zip(own.names, own.units, strict=True)):
        numbers = (own.values[k], stated[k], drawn[k], over[k], lower[k], upper[k])
        cells = (name, *(significant(float(x)) for x in numbers), unit)
        rows.append(Row(cells, bool(over[k] > FAR)))
    failed = f" {found.failed} draws gave no estimate." if found.failed else ""
    return PlainTable(
        f"{len(found.draws)} draws of {found.windows} windows",
        "Windows of every run are drawn again with replacement, and the whole estimate is made "
        f"anew.{failed} Where it scatters more than {FAR:g} times what was stated (bold), windows "
        "do not agree with each other, so the model misses something there, or a body lies at the "
        "edge of what can exist, where the stated interval is too narrow. What a prior holds in "
        "place scatters less than it is uncertain.",
        ("Parameter", "Value", "Std stated", "Std drawn", "Ratio", "2.5 %", "97.5 %", "Unit"),
        rows,
        (0, 7),
    )
