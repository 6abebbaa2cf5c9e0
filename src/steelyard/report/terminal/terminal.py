"""The report in a terminal, and the parameters as a table for other programs."""

from __future__ import annotations

import csv
import io
from math import isfinite
from typing import TYPE_CHECKING

from steelyard.regression.khalil_symbols import symbols
from steelyard.report.content import ReportContent
from steelyard.report.sections.register import sections_of
from steelyard.report.text.table import rows

if TYPE_CHECKING:
    from rich.console import Console

    from steelyard.estimation.identified import IdentifiedModel

CSV_COLUMNS = (
    "name",
    "group",
    "value",
    "unit",
    "std",
    "lower95",
    "upper95",
    "relative_std_percent",
    "status",
    "symbol",
    "from_data_percent",
)


def summary(content: ReportContent, console: Console, verbose: bool = False) -> None:
    """Print what the sections have for a terminal, and the notes.

    Args:
        content: The report.
        console: Where to print.
        verbose: Whether to print the details too.
    """
    from rich.text import Text

    sections = sections_of(content)
    shown = [part for section in sections for part in section.printed(content)]
    if verbose:
        shown += [part for section in sections for part in section.detailed(content)]
    for number, part in enumerate(shown):
        if number:
            console.print()
        console.print(part)
    for note in (*content.notes, *(content.details if verbose else ())):
        console.print(Text(f"note: {note}"))


def parameters_csv(identified: IdentifiedModel) -> str:
    """All base parameters as CSV: values, intervals, and whether the data see them."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    base = identified.base
    symbol = dict(zip(base.base_names, symbols(identified.model.robot, base), strict=True))
    for row in rows(identified):
        numbers = (row.value, row.std, row.lower, row.upper, row.relative_percent)
        value, std, lower, upper, relative = (_exact(number) for number in numbers)
        writer.writerow(
            [row.name, row.group, value, row.unit, std, lower, upper, relative, row.status]
            + [symbol.get(row.name, row.name), _exact(row.learned_percent)]
        )
    return text.getvalue()


def _exact(number: float | None) -> str:
    return "" if number is None or not isfinite(number) else repr(float(number))
