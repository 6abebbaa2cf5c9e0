"""A designed motion in a terminal."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from steelyard.excitation.constraints.certificate import COVERS
from steelyard.report.text.design_words import (
    brings,
    capital,
    detail,
    expected,
    headline,
    helpful,
    level,
    scopes,
    spread_words,
    tightest,
    uncovered,
    unseen,
)
from steelyard.report.text.verdict import COLOURS
from steelyard.report.text.words import count, relative, significant

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from steelyard.excitation.result import Designed

WORST = 5
"""Parameters that are named."""

ADVISED = 3
"""Most lines of advice, each of which names one parameter."""

FAILED = 5
"""Most lines about what is not proven."""


def design_summary(designed: Designed, console: Console) -> None:
    """Print the figure, what is tight, the worst shown parameters, and what else would help.

    Args:
        designed: The motion.
        console: Where to print.
    """
    from rich.text import Text

    shown = designed.shown
    console.print(Text(headline(designed), style=f"bold {COLOURS[level(designed)]}"))
    if scope := scopes(designed):
        console.print(Text(f"limits: {scope}"))
    console.print(Text(detail(designed)))
    figures = f"condition {significant(shown.raw)}, normalised {significant(shown.normalised)}"
    console.print(Text(f"{figures}, {count(len(shown.names), 'base parameter')}"))
    failures = designed.certificate.failures
    for line in failures[:FAILED]:
        console.print(Text(f"not proven: {line}", style="red"))
    if len(failures) > FAILED:
        console.print(Text(f"not proven: {len(failures) - FAILED} more", style="red"))
    console.print(Text(f"covered: {COVERS}"))
    for line in uncovered(designed):
        console.print(Text(f"not covered: {line}", style="yellow"))
    for line in tightest(designed):
        console.print(Text(f"smallest margins: {line}"))
    console.print()
    console.print(_worst(designed))
    console.print(
        Text("inflation: std divided by its value with all other parameters known (√VIF)")
    )
    missing = unseen(designed)
    if missing:
        console.print(
            Text(f"{count(missing, 'parameter')} will not be identifiable", style="yellow")
        )
    console.print(Text(f"noise: {designed.noise_from}"))
    console.print()
    for one in helpful(designed.advice)[:ADVISED]:
        console.print(
            Text(
                f"{capital(one.what)} ({one.seconds:.3g} s) reduces the std of "
                f"{brings(designed, one, 1)}"
            )
        )
    for note in designed.notes:
        if note in uncovered(designed):
            continue
        console.print(Text(f"note: {note}"))


def _worst(designed: Designed) -> Table:
    """The parameters that are least accurate parameters."""
    from rich.table import Table
    from rich.text import Text

    rows = expected(designed)[:WORST]
    valued = any(one.relative_percent is not None for one in rows)
    table = Table(title=Text("least accurate parameters"), title_justify="left")
    table.add_column("parameter", overflow="fold")
    table.add_column("std", justify="right")
    table.add_column("unit")
    if valued:
        table.add_column("of value", justify="right")
    table.add_column("inflation", justify="right")
    for one in rows:
        std = significant(one.std, 2) if isfinite(one.std) else "not identifiable"
        share = [relative(one.relative_percent)] if valued else []
        table.add_row(Text(one.name), std, Text(one.unit), *share, spread_words(one.spread))
    return table
