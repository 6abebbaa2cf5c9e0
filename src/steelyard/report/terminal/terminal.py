"""The report in a terminal, and the parameters as a table for other programs."""

from __future__ import annotations

import csv
import io
from math import isfinite
from typing import TYPE_CHECKING

from steelyard.regression.khalil_symbols import symbols
from steelyard.report.content import ReportContent
from steelyard.report.sections.effort import band_text
from steelyard.report.terminal import causes
from steelyard.report.text.judgement import Level, level_of, verdict
from steelyard.report.text.score_words import coverage_words, relative
from steelyard.report.text.table import Row, rows
from steelyard.report.text.words import count, percent, significant

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from steelyard.estimation.identified import IdentifiedModel
    from steelyard.validation.score import RunScore

COLOURS: dict[Level, str] = {"good": "green", "fair": "yellow", "poor": "red", "none": "default"}

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

CAPTION = (
    "moving, all: relative error where the joint moves, and of the whole log; pooled: norms over "
    "all joints together; zero, nominal: RMSE of predicting zero, and of the nominal model"
)

NAMED = 8
"""Most parameters that a line of the terminal names."""


def summary(content: ReportContent, console: Console) -> None:
    """Print the verdict, the scores of every joint, and what could not be seen.

    Args:
        content: The report.
        console: Where to print.
    """
    from rich.text import Text

    judged = verdict(content)
    console.print(Text(judged.line, style=f"bold {COLOURS[judged.level]}"))
    console.print(Text(judged.detail))
    for sentence, level in judged.limitations:
        console.print(Text(f"! {sentence}", style=COLOURS[level]))
    for score in content.scores or content.fitted:
        console.print()
        console.print(_table(score, bool(content.scores)))
        if score.coverage_percent is not None:
            inside = coverage_words(score.coverage_percent, bool(content.scores))
            console.print(Text(f"95 % bands {band_text(content.identified)}; {inside}"))
    for table in causes.tables(content):
        console.print()
        console.print(table)
    if content.identified is not None:
        console.print()
        for line in _parameters(content.identified):
            console.print(Text(line))
    for note in content.notes:
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


def _table(score: RunScore, unseen: bool) -> Table:
    from rich.table import Table
    from rich.text import Text

    again = f"not fitted, repeats the motion of {score.repeats}" if score.repeats else "not fitted"
    kind = again if unseen else "fitted"
    table = Table(
        title=Text(f"{score.run} ({kind}, below {score.cutoff:g} Hz)"),
        title_justify="left",
        caption=CAPTION,
        caption_justify="left",
    )
    table.add_column("joint", overflow="fold")
    for heading in ("moving", "all", "RMSE", "zero", "nominal"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    for joint in score.joints:
        style = COLOURS[level_of(relative(joint))]
        table.add_row(
            Text(joint.joint),
            Text(percent(joint.relative_percent_moving), style=style),
            percent(joint.relative_percent),
            significant(joint.rmse),
            significant(joint.predict_zero),
            significant(joint.prior_rmse),
            Text(joint.unit),
        )
    table.add_section()
    if score.pooled_percent is not None:
        pooled = percent(score.pooled_percent_moving), percent(score.pooled_percent)
        table.add_row("pooled", *pooled)
    table.add_row("mean", percent(score.mean_percent_moving), percent(score.mean_percent))
    return table


def _parameters(identified: IdentifiedModel) -> list[str]:
    """What is known of the parameters, in a few lines."""
    table = rows(identified)
    condition = significant(identified.estimate.condition_normalised)
    lines = [f"{count(len(table), 'base parameter')}, normalised condition number {condition}"]
    weak = [row for row in table if row.grade in ("weak", "zero")]
    if weak:
        lines.append(f"{len(weak)} poorly determined: {_some(weak)}")
    held = [row for row in table if row.grade == "bound"]
    if held:
        lines.append(f"{len(held)} at a bound: {_some(held)}")
    prior = [row for row in table if row.grade == "prior"]
    if prior:
        lines.append(f"{len(prior)} known mostly from the prior: {_some(prior)}")
    unseen = [row for row in table if row.grade == "unseen"]
    if unseen:
        lines.append(f"{len(unseen)} not seen by these data: {_some(unseen)}")
    return lines


def _some(chosen: list[Row]) -> str:
    rest = len(chosen) - NAMED
    return ", ".join(row.name for row in chosen[:NAMED]) + (f" and {rest} more" if rest > 0 else "")
