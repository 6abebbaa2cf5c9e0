"""Estimators beside each other, in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from steelyard.report.content import ReportContent
from steelyard.report.sections.model.compare import (
    failure_words,
    headline,
    in_order,
    main_table,
    stopped,
)
from steelyard.report.sections.tables import PlainTable
from steelyard.report.text.words import NONE

if TYPE_CHECKING:
    from rich.console import Console

SHOWN = (0, 1, 2, 4, 7)
"""Columns of the main table for which a terminal has room."""

CONDITION = 6
"""The column that is shown where the condition numbers differ."""

USUAL = 0.8
"""Share of the rows with one condition number from which on it tells nothing."""

ABOUT = {
    "Condition": "condition number of the whitened regressor, columns of unit length",
    "χ²": "squared residuals over the noise variance by WLS, per degree of freedom: about 1 for "
    "WLS; an excess is due to constraints, a prior or other weights",
}
"""What columns say that do not speak for themselves."""


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
    columns = _columns(shown)
    for number in columns:
        side: Literal["left", "right"] = "left" if number in shown.text else "right"
        table.add_column(shown.headings[number], justify=side)
    for row in shown.rows:
        cells = (Text(row.cells[number]) for number in columns)
        table.add_row(*cells, style="bold" if row.marked else "")
    console.print(Text(comparison.words))
    console.print()
    console.print(table)
    for number in columns:
        if shown.headings[number] in ABOUT:
            heading = shown.headings[number]
            console.print(Text(f"{heading}: {ABOUT[heading]}"))
    for score in in_order(comparison):
        for when, reason, fix in failure_words(score.failures, len(comparison.parts)):
            console.print(Text(f"{score.name} failed ({when}): {reason}; {fix}", style="yellow"))
    console.print()
    advice = comparison.advice
    console.print(Text(headline(comparison), style="bold"))
    if advice is not None:
        for score in comparison.scores:
            if score.name == advice.name:
                console.print(Text(f"{score.name}: {score.about}"))
        console.print(Text(advice.why))
    if comparison.setting:
        console.print(Text(f"in the robot file: {comparison.setting}"))
    if stopped(comparison):
        console.print(Text(stopped(comparison), style="bold yellow"))
    for note in content.notes:
        console.print(Text(f"note: {note}"))


def _columns(shown: PlainTable) -> tuple[int, ...]:
    """Those for which there is room, and the condition where it tells estimators apart."""
    told = [row.cells[CONDITION] for row in shown.rows if row.cells[CONDITION] != NONE]
    same = max((told.count(cell) for cell in told), default=0)
    differ = same < USUAL * len(told)
    return tuple(sorted((*SHOWN, CONDITION))) if differ else SHOWN
