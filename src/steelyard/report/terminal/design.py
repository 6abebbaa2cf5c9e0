"""A designed motion in a terminal."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from steelyard.excitation.constraints.certificate import COVERS
from steelyard.report.sections.tables import light_table
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
from steelyard.report.text.words import COLOURS, count, relative, significant

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


def design_summary(designed: Designed, console: Console, verbose: bool = False) -> None:
    """Print the verdict, what is not covered, the tightest limit, the least accurate parameters.

    Args:
        designed: The motion.
        console: Where to print.
        verbose: Whether to print scopes, all tight limits, all advice and the notes too.
    """
    from rich.text import Text

    shown, tight = designed.shown, tightest(designed)
    console.print(Text(headline(designed), style=f"bold {COLOURS[level(designed)]}"))
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
    for line in tight if verbose else tight[:1]:
        console.print(Text(f"smallest margins: {line}"))
    console.print()
    console.print(Text("least accurate parameters"))
    console.print(_worst(designed))
    missing = unseen(designed)
    if missing:
        console.print(
            Text(f"{count(missing, 'parameter')} will not be identifiable", style="yellow")
        )
    console.print()
    advice = helpful(designed.advice)[:ADVISED]
    for one in advice if verbose else advice[:1]:
        console.print(
            Text(
                f"{capital(one.what)} ({one.seconds:.3g} s) reduces the std of "
                f"{brings(designed, one, 1)}"
            )
        )
    if verbose:
        for line in _details(designed):
            console.print(Text(line))


def _details(designed: Designed) -> list[str]:
    """What the verdict is about, what columns and deviations mean, and the notes."""
    scope = scopes(designed)
    return [
        *([f"limits: {scope}"] if scope else []),
        "inflation: std divided by what it would be if all other parameters were known (√VIF)",
        f"noise: {designed.noise_from}",
        *(f"note: {note}" for note in designed.notes if note not in uncovered(designed)),
    ]


def _worst(designed: Designed) -> Table:
    """The parameters that are least accurate."""
    from rich.text import Text

    rows = expected(designed)[:WORST]
    valued = any(one.relative_percent is not None for one in rows)
    of_value = ("of value",) if valued else ()
    table = light_table(("parameter", "std", "unit", *of_value, "inflation"), (0, 2))
    for one in rows:
        std = significant(one.std, 2) if isfinite(one.std) else "not identifiable"
        share = [relative(one.relative_percent)] if valued else []
        table.add_row(Text(one.name), std, Text(one.unit), *share, spread_words(one.spread))
    return table
