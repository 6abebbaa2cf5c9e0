"""What was found about the causes of torque, for the terminal: friction, fields, drive gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

from steelyard.report.content import ReportContent
from steelyard.report.sections.friction import ERROR
from steelyard.report.text.words import significant

if TYPE_CHECKING:
    from rich.table import Table

    from steelyard.estimation.fields.fields import Finding
    from steelyard.estimation.payload.gains import GainEstimate
    from steelyard.validation.friction.friction import FrictionChoice


def tables(content: ReportContent) -> list[Table]:
    """One table for each of them that there is."""
    found = []
    if content.friction is not None:
        found.append(_mixes(content.friction))
    if content.findings:
        found.append(_fields(content.findings))
    if content.gains is not None:
        found.append(_gains(content.gains))
    return found


def _mixes(choice: FrictionChoice) -> Table:
    from rich.text import Text

    table = _table(f"Friction laws, one {choice.left_out} left out in turn")
    table.caption, table.caption_justify = Text(f"error: {ERROR}"), "left"
    table.add_column("mix", overflow="fold")
    for heading in ("error", "gain", "spread"):
        table.add_column(heading, justify="right")
    table.add_column("")
    for mix in choice.table:
        table.add_row(
            Text(mix.name),
            f"{mix.error:.2f} %",
            f"{mix.gain:.1f} %",
            f"± {mix.spread:.1f}",
            "chosen" if mix.chosen else "",
            style="bold green" if mix.chosen else None,
        )
    return table


def _fields(findings: tuple[Finding, ...]) -> Table:
    from rich.text import Text

    table = _table("Fields found, with 95 % intervals")
    for heading in ("field", "joint"):
        table.add_column(heading, overflow="fold")
    for heading in ("value", "from", "to"):
        table.add_column(heading, justify="right")
    for finding in findings:
        table.add_row(
            Text(f"{finding.term}: {finding.field}"),
            Text(finding.joint or "all"),
            *(significant(x) for x in (finding.value, *finding.interval)),
            style=None if finding.told else "yellow",
        )
    return table


def _gains(gains: GainEstimate) -> Table:
    from rich.text import Text

    table = _table("Drive gains, with 95 % intervals")
    table.add_column("joint", overflow="fold")
    for heading in ("gain", "±"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    for joint, gain, half, unit, known, assumed in gains.each:
        interval = "assumed" if assumed else "given" if known else significant(half)
        table.add_row(Text(joint), significant(gain), interval, unit)
    return table


def _table(title: str) -> Table:
    from rich.table import Table
    from rich.text import Text

    return Table(title=Text(title), title_justify="left")
