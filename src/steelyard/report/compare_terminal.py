"""Estimators beside each other, in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from steelyard.report.content import ReportContent
from steelyard.report.sections.compare import (
    failure_words,
    headline,
    in_order,
    main_table,
    stopped,
)

if TYPE_CHECKING:
    from rich.console import Console

SHOWN = (0, 1, 2, 4, 6, 7)
"""Columns of the main table for which a terminal has room."""


def comparison_lines(content: ReportContent, console: Console) -> None:
    """Print the table, what failed, the advice and the notes.

    Args:
        content: A report with a comparison.
        console: Where to print.
    """
    from rich.table import Table
    from rich.text import Text

    comparison = content.comparison
    if comparison is None:
        return
    shown = main_table(comparison)
    table = Table(title=Text(shown.caption), title_justify="left")
    for number in SHOWN:
        side: Literal["left", "right"] = "left" if number in shown.text else "right"
        table.add_column(shown.headings[number], justify=side)
    for row in shown.rows:
        cells = (Text(row.cells[number]) for number in SHOWN)
        table.add_row(*cells, style="bold" if row.marked else "")
    console.print(Text(comparison.words))
    console.print()
    console.print(table)
    for trial in in_order(comparison):
        for when, reason, mend in failure_words(trial.failures, len(comparison.parts)):
            console.print(Text(f"{trial.name} failed ({when}): {reason}; {mend}", style="yellow"))
    console.print()
    advice = comparison.advice
    console.print(Text(headline(comparison), style="bold"))
    if advice is not None:
        console.print(Text(advice.why))
    if stopped(comparison):
        console.print(Text(stopped(comparison), style="bold yellow"))
    for note in content.notes:
        console.print(Text(f"note: {note}"))
