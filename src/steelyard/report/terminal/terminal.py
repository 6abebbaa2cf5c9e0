"""The report in a terminal, and the parameters as a table for other programs."""

from __future__ import annotations

import csv
import io
from dataclasses import fields
from math import isfinite
from typing import TYPE_CHECKING

from steelyard.report.content import ReportContent
from steelyard.report.sections.register import sections_of
from steelyard.report.text.table import Row, rows

if TYPE_CHECKING:
    from rich.console import Console

    from steelyard.estimation.identified import IdentifiedModel

CSV_COLUMNS = tuple(field.name for field in fields(Row))
"""Columns of `parameters.csv`."""


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
    """All base parameters as CSV: values, intervals, and how well they are identified."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    writer.writerows(
        [_cell(getattr(row, name)) for name in CSV_COLUMNS] for row in rows(identified)
    )
    return text.getvalue()


def _cell(value: str | float | None) -> str:
    if isinstance(value, str):
        return value
    return "" if value is None or not isfinite(value) else repr(float(value))
