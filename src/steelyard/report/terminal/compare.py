"""Estimators beside each other, in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from steelyard.report.content import ReportContent
from steelyard.report.sections.estimation.compare import (
    failure_words,
    headline,
    in_order,
    main_table,
    stopped,
)
from steelyard.report.sections.tables import PlainTable, light_table
from steelyard.report.text.words import NONE

if TYPE_CHECKING:
    from rich.console import Console

    from steelyard.validation.comparison import Comparison

SHOWN = (0, 1, 2, 4, 7)
"""Columns of the main table for which a terminal has room."""

MOST = 10
"""Estimators that are shown, the best first; with `--verbose` all of them."""

CONDITION = 6
"""The column that is shown where the condition numbers differ."""

USUAL = 0.8
"""Share of the rows with one condition number from which on it distinguishes nothing."""

ABOUT = {
    "Condition": "condition number of the whitened regressor, columns of unit length",
    "χ²": "squared residuals over the noise variance by WLS, per degree of freedom: about 1 for "
    "WLS; an excess is due to constraints, a prior or other weights",
}
"""What columns say that do not speak for themselves."""


def comparison_lines(content: ReportContent, console: Console, verbose: bool = False) -> None:
    """Print the recommendation with its reason, the table, and what failed.

    Args:
        content: A report with a comparison.
        console: Where to print.
        verbose: Whether to print all estimators, what the columns say, and the notes.
    """
    from rich.text import Text

    comparison = content.comparison
    if comparison is None:
        return
    console.print(Text(headline(comparison), style="bold"))
    for line in _advice(comparison):
        console.print(Text(line))
    if stopped(comparison):
        console.print(Text(stopped(comparison), style="bold yellow"))
    console.print()
    shown = main_table(comparison)
    most = len(shown.rows) if verbose else MOST
    columns = _columns(shown)
    table = light_table(
        [shown.headings[k] for k in columns], [k for k, c in enumerate(columns) if c in shown.text]
    )
    for row in shown.rows[:most]:
        cells = (Text(row.cells[number]) for number in columns)
        table.add_row(*cells, style="bold" if row.marked else "")
    console.print(Text(f"{shown.caption}. {comparison.words}"))
    console.print(table)
    if rest := [row.cells[0] for row in shown.rows[most:]]:
        console.print(Text(f"and {len(rest)} more: {', '.join(rest)} (-v)"))
    if verbose:
        for number in columns:
            if shown.headings[number] in ABOUT:
                heading = shown.headings[number]
                console.print(Text(f"{heading}: {ABOUT[heading]}"))
    for score in in_order(comparison):
        for when, reason, fix in failure_words(score.failures, len(comparison.parts)):
            console.print(Text(f"{score.name} failed ({when}): {reason}; {fix}", style="yellow"))
    for note in (*content.notes, *(content.details if verbose else ())):
        console.print(Text(f"note: {note}"))


def _advice(comparison: Comparison) -> list[str]:
    """What the recommended estimator is, why, and how to use it."""
    advice, lines = comparison.advice, []
    if advice is not None:
        lines += [f"{s.name}: {s.about}" for s in comparison.scores if s.name == advice.name]
        lines.append(advice.why)
    if comparison.setting:
        lines.append(f"in the robot file: {comparison.setting}")
    return lines


def _columns(shown: PlainTable) -> tuple[int, ...]:
    """Those for which there is room, and the condition number where it differs."""
    known = [row.cells[CONDITION] for row in shown.rows if row.cells[CONDITION] != NONE]
    same = max((known.count(cell) for cell in known), default=0)
    differ = same < USUAL * len(known)
    return tuple(sorted((*SHOWN, CONDITION))) if differ else SHOWN
