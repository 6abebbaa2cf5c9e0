"""The parameters: values, intervals, groupings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.text.table import LEARNED, WEAK, Grade, Row, rows
from steelyard.report.text.words import count, significant
from steelyard.terms.register import description_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from steelyard.estimation.identified import IdentifiedModel

GRADES: tuple[tuple[str, tuple[Grade, ...]], ...] = (
    ("well identified", ("sure",)),
    ("poorly identifiable", ("weak", "zero")),
    ("at a bound", ("bound",)),
    ("known", ("known",)),
    ("mostly from the prior", ("prior",)),
    ("not identifiable from these data", ("unseen",)),
)
"""How the line of the terminal counts the parameters."""

ONE_BY_ONE = "Predictions use all parameters; as single values use the well identified ones."
"""What a small error does not say."""

NAMED = 8
"""Most parameters that a line of the terminal names."""


class ParametersSection(Section):
    """A table of base parameters, with a mark on those that are poorly identifiable."""

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
            "known": sum(row.grade == "known" for row in table),
            "weak": WEAK,
            "little": LEARNED,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("parameters.html", numbers)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The parameters that the data see, the names of the others, and the conditioning."""
        if content.identified is None:
            return {}
        estimate = content.identified.estimate
        known = estimate.parameters
        values = zip(
            known.names, known.units, known.values.tolist(), estimate.std.tolist(), strict=True
        )
        return {
            "n_base_parameters": len(content.identified.base),
            "parameters": [{"name": n, "unit": u, "value": v, "std": s} for n, u, v, s in values],
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
    """Counts of the parameters by grade; unless all are good, what to use them for."""
    table = rows(identified)
    grades = [(words, sum(row.grade in of for row in table)) for words, of in GRADES]
    named = ", ".join(f"{number} {words}" for words, number in grades if number)
    removed = sum(row.grade == "removed" for row in table)
    taken = f"; {removed} removed, taken as zero" if removed else ""
    all_good = all(row.grade in ("sure", "removed", "known") for row in table)
    words = f"{count(len(table) - removed, 'base parameter')}: {named}{taken}"
    return words, *(() if all_good else (ONE_BY_ONE,))


def _shown(row: Row, members: int) -> dict[str, Any]:
    relative = row.relative_percent
    bar = 100.0 if relative is None or not relative < 100.0 else relative
    return {**vars(row), "bar": bar, "others": members - 1}


def _parameters(identified: IdentifiedModel) -> list[str]:
    """What is known of the parameters, in a few lines."""
    table = rows(identified)
    condition = significant(identified.estimate.condition_normalised)
    removed = [row for row in table if row.grade == "removed"]
    left = count(len(table) - len(removed), "base parameter")
    lines = [f"{left}, normalised condition number {condition}"]
    if removed:
        lines.append(f"{len(removed)} removed, taken as zero: {_some(removed)}")
    weak = [row for row in table if row.grade in ("weak", "zero")]
    if weak:
        lines.append(f"{len(weak)} poorly identifiable: {_some(weak)}")
    at_bound = [row for row in table if row.grade == "bound"]
    if at_bound:
        lines.append(f"{len(at_bound)} at a bound: {_some(at_bound)}")
    known = [row for row in table if row.grade == "known"]
    if known:
        lines.append(f"{len(known)} known, not estimated: {_some(known)}")
    prior = [row for row in table if row.grade == "prior"]
    if prior:
        lines.append(f"{len(prior)} mostly from the prior: {_some(prior)}")
    unseen = [row for row in table if row.grade == "unseen"]
    if unseen:
        lines.append(f"{len(unseen)} not identifiable from these data: {_some(unseen)}")
    return lines


def _some(chosen: list[Row]) -> str:
    rest = len(chosen) - NAMED
    return ", ".join(row.name for row in chosen[:NAMED]) + (f" and {rest} more" if rest > 0 else "")
