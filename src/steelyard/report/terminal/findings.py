"""What the checks found, in a terminal: a table, the lines that correct it, the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from steelyard.report.text.findings import (
    LEVELS,
    OPEN,
    Group,
    by_edits,
    fixes,
    groups,
    headline,
    lines,
    place,
    tally,
    words_of,
)
from steelyard.report.text.words import COLOURS, count

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from steelyard.diagnosis import Diagnosis, Finding

SHOWN = 3
"""Findings of one check and severity that are shown one by one."""

PAYLOAD = "payload"
"""The check whose masses a fitted model corrects."""

COARSE = (
    "; this mass contains the errors of the model file's masses: if a line with ! names another "
    "one for this log, that is more accurate, as it is by the identified model"
)
"""What a note says of such a mass."""

NAMED = 4
"""Logs that are named after them."""


def show(
    diagnosis: Diagnosis, console: Console, *, fine: bool = True, verbose: bool = False
) -> None:
    """Print the findings, the worst last, then what to do and the verdict.

    Args:
        diagnosis: What was found.
        fine: Whether to print those that are ok.
        verbose: Whether to print each of these, not the names alone of those without a `brief`.
        console: Where to print.
    """
    from rich.padding import Padding
    from rich.text import Text

    worst = words_of(diagnosis)
    shown = [
        group
        for group in groups(diagnosis)
        if (fine or group.severity) and (verbose or worst[group.check] == group.word)
    ]
    if shown:
        console.print(_table(shown, verbose))
    for fix, findings in fixes(diagnosis).values():
        names = ", ".join(dict.fromkeys(f.check for f in findings))
        console.print()
        console.print(Text.assemble((f"fix {names}: ", "bold"), fix.says))
        if fix.edits:
            console.print(Padding(Text(lines(fix.edits), style="cyan"), (0, 0, 0, 4)))
    if shown:
        console.print()
    style = f"bold {COLOURS[LEVELS[diagnosis.severity.word]]}"
    counts = f"  ({tally(diagnosis)})" if any(f.severity for f in diagnosis.findings) else ""
    console.print(Text.assemble((headline(diagnosis), style), counts))


def notes(diagnosis: Diagnosis) -> tuple[str, ...]:
    """The findings that are not ok, one sentence per check."""
    sentences = []
    for group in groups(diagnosis):
        if group.severity:
            first = group.findings[0]
            more = _others(group, 1)
            where = f"{place(first)}: " if place(first) else ""
            sentences.append(
                f"check, {group.check}: {where}{first.says} ({first.figure})"
                + (COARSE if group.check == PAYLOAD and first.nominal else "")
                + (f"; {more}" if more else "")
            )
    return tuple(sentences)


def _table(shown: Sequence[Group], verbose: bool) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(max_width=18)
    table.add_column(ratio=1)
    before = None
    passed = (
        [] if verbose else [group for group in shown if group.word == "ok" and not _brief(group)]
    )
    if passed:
        names = ", ".join(group.check for group in passed)
        table.add_row(
            Text("ok", style=f"bold {COLOURS['good']}"), count(len(passed), "check"), names
        )
        before = passed[0].severity
    for group in (group for group in shown if group not in passed):
        alike = _open_alike(shown, group)
        if alike and alike[0] is not group:
            continue
        if before not in (None, group.severity):
            table.add_row()
        before = group.severity
        style = f"bold {COLOURS[group.level]}" if group.word != OPEN else "dim"
        word = Text(group.word, style=style)
        name, found = Text(group.check), _found(group)
        if not verbose and group.word == "ok":
            found = Text(_brief(group))
        if len(alike) > 1:
            name = Text(count(len(alike), "check"))
            found = Text(", ".join(g.check for g in alike) + ": ").append_text(found)
        table.add_row(word, name, found)
    return table


def _brief(group: Group) -> str:
    """What findings say in brief, each with its log if several do; empty if none does."""
    said = [finding for finding in group.findings if finding.brief]
    if len(group.findings) == 1:
        return "".join(finding.brief for finding in said)
    more = [f"and {len(said) - SHOWN} more logs"] if len(said) > SHOWN else []
    return "; ".join([*(f"{f.log}: {f.brief}" for f in said[:SHOWN]), *more])


def _open_alike(shown: Sequence[Group], group: Group) -> list[Group]:
    """The open questions that are open for the same reason."""
    says = group.findings[0].says
    if group.word != OPEN:
        return []
    return [g for g in shown if g.word == OPEN and g.findings[0].says == says]


def _found(group: Group) -> Text:
    """What one row says; of many that are ok the first speaks."""
    from rich.text import Text

    first, others = group.findings[0], {finding.log for finding in group.findings[1:]}
    if not group.severity:
        return Text.assemble((_speaks(group, first, others - {first.log}), "dim"), first.says)
    shown = []
    for one, *same in by_edits(group.findings[:SHOWN]):
        alike = ", ".join(f"{place(other)} ({other.figure})" for other in same)
        shown += [_one(one), *([Text(f"the same in {alike}")] if same else [])]
    rest = _others(group, SHOWN)
    return Text("\n").join([*shown, Text(rest, style="dim")] if rest else shown)


def _speaks(group: Group, first: Finding, others: set[str]) -> str:
    """Which logs a sentence is about that stands for findings of several."""
    if not others:
        return ""
    logs = count(len(others - {""}) + bool(first.log), "log")
    together = ["all logs together"] if "" in others or not first.log else []
    every = " and ".join([logs, *together])
    if all(finding.says == first.says for finding in group.findings):
        return f"{every}: "
    if len(others) == len(together):
        return f"{first.log} (and all logs together): "
    return f"{every}; the first, {first.log or 'all logs together'}: "


def _one(finding: Finding) -> Text:
    from rich.text import Text

    parts = [(f"{place(finding)}: ", "bold")] if place(finding) else []
    figure = [(f"\n{finding.figure}", "dim")] if finding.figure else []
    return Text.assemble(*parts, finding.says, *figure)


def _others(group: Group, shown: int) -> str:
    """The logs of the findings that are not shown."""
    rest = [finding.log or "all logs" for finding in group.findings[shown:]]
    if not rest:
        return ""
    more = len(rest) - NAMED
    return f"and {len(rest)} more: {', '.join(rest[:NAMED])}" + (
        f" and {more} others" if more > 0 else ""
    )
