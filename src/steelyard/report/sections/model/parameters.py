"""The parameters: values, intervals, groupings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.estimation.status import FROM_DATA, SMALL, WELL, Status, statuses
from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.text.table import Row, rows
from steelyard.report.text.words import count, significant
from steelyard.terms.register import description_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from steelyard.estimation.identified import IdentifiedModel

ORDER: tuple[Status, ...] = (
    "identified",
    "small effect",
    "poorly identified",
    "at a bound",
    "known",
    "from the prior",
    "not identifiable",
)
"""How the line of the terminal counts the parameters."""

GOOD: tuple[Status, ...] = ("identified", "small effect", "known", "removed")
"""Parameters of which another motion would change little."""

ONE_BY_ONE = (
    "For predictions use the whole model; rely on single values only if identified, and on several "
    "friction laws of a joint only as one curve."
)
"""What a small error does not say."""

NAMED = 8
"""Most parameters that a line of the terminal names."""


class ParametersSection(Section):
    """A table of base parameters, with the status of each."""

    name: ClassVar[str] = "parameters"
    title: ClassVar[str] = "Parameters"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Rows of the parameters that the data see."""
        if content.identified is None:
            return None
        table = [row for row in rows(content.identified) if row.status != "not identifiable"]
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
            "counts": counts(table),
            "statuses": {row.status for row in table},
            "learned": any(row.from_data_percent is not None for row in table),
            "well": WELL,
            "small": SMALL,
            "from_data": FROM_DATA,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("parameters.html", numbers)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The parameters that the data see, the names of the others, and the conditioning."""
        if content.identified is None:
            return {}
        estimate = content.identified.estimate
        known, status = estimate.parameters, statuses(content.identified)
        values = zip(
            known.names, known.units, known.values.tolist(), estimate.std.tolist(), strict=True
        )
        return {
            "n_base_parameters": len(content.identified.base),
            "parameters": [
                {"name": n, "unit": u, "value": v, "std": s, "status": status[n]}
                for n, u, v, s in values
            ],
            "terms": [description_of(term) for term in content.identified.model.terms],
            "not_seen": [blind.name for blind in estimate.blind],
            "removed": [vars(one) for one in estimate.removed],
            "known": list(estimate.known),
            "condition": estimate.condition,
            "condition_normalised": estimate.condition_normalised,
        }

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """How many parameters there are, and how many the data show poorly or not at all."""
        if content.identified is None:
            return
        from rich.text import Text

        yield Text("\n".join(usable(content.identified)))

    def detailed(self, content: ReportContent) -> Iterable[RenderableType]:
        """Which the data show poorly or not at all."""
        if content.identified is None:
            return
        from rich.text import Text

        yield Text("\n".join(_parameters(content.identified)))


def usable(identified: IdentifiedModel) -> tuple[str, ...]:
    """Counts of the parameters by status; unless all are good, what to use them for."""
    table = rows(identified)
    removed = sum(row.status == "removed" for row in table)
    taken = f"; {removed} removed, taken as zero" if removed else ""
    words = f"{count(len(table) - removed, 'base parameter')}: {counts(table)}{taken}"
    return words, *(() if all(row.status in GOOD for row in table) else (ONE_BY_ONE,))


def counts(table: Sequence[Row]) -> str:
    """Like `40 identified, 3 small effect`, without removed parameters."""
    numbers = ((status, sum(row.status == status for row in table)) for status in ORDER)
    return ", ".join(f"{number} {status}" for status, number in numbers if number)


def _shown(row: Row, members: int) -> dict[str, Any]:
    relative = row.relative_std_percent
    bar = 100.0 if relative is None or not relative < 100.0 else relative
    return {**vars(row), "bar": bar, "others": members - 1}


def _parameters(identified: IdentifiedModel) -> list[str]:
    """What is known of the parameters, in a few lines."""
    table = rows(identified)
    condition = significant(identified.estimate.condition_normalised)
    removed = [row for row in table if row.status == "removed"]
    left = count(len(table) - len(removed), "base parameter")
    lines = [f"{left}, normalised condition number {condition}"]
    if removed:
        lines.append(f"{len(removed)} removed, taken as zero: {_some(removed)}")
    for status in ORDER[1:]:
        if chosen := [row for row in table if row.status == status]:
            lines.append(f"{len(chosen)} {status}: {_some(chosen)}")
    return lines


def _some(chosen: list[Row]) -> str:
    rest = len(chosen) - NAMED
    return ", ".join(row.name for row in chosen[:NAMED]) + (f" and {rest} more" if rest > 0 else "")
