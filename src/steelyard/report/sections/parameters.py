"""The parameters: values, intervals, groupings."""

from typing import Any, ClassVar

import numpy as np

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers
from steelyard.report.text.table import LEARNED, WEAK, Row, rows


class ParametersSection:
    """A table of base parameters, with a mark on those that are poorly determined."""

    name: ClassVar[str] = "parameters"
    title: ClassVar[str] = "Parameters"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Rows of the parameters that the data see."""
        if content.identified is None:
            return None
        table = [row for row in rows(content.identified) if row.grade != "unseen"]
        base = content.identified.base
        terms = dict(
            zip(base.base_names, np.count_nonzero(base.lift, axis=1).tolist(), strict=True)
        )
        sizes = [terms.get(row.name, 1) for row in table]
        return {
            "rows": [_shown(row, members) for row, members in zip(table, sizes, strict=True)],
            "grouped": any(members > 1 for members in sizes),
            "nominal": any(row.nominal is not None for row in table),
            "estimator": content.identified.estimate.estimator,
            "poor": sum(row.grade in ("weak", "zero") for row in table),
            "learned": any(row.learned_percent is not None for row in table),
            "prior": sum(row.grade == "prior" for row in table),
            "bound": sum(row.grade == "bound" for row in table),
            "weak": WEAK,
            "little": LEARNED,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("parameters.html", numbers)


def _shown(row: Row, members: int) -> dict[str, Any]:
    relative = row.relative_percent
    bar = 100.0 if relative is None or not relative < 100.0 else relative
    return {**vars(row), "bar": bar, "others": members - 1}
