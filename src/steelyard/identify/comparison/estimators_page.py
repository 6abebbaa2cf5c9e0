"""Page and terminal text of `steelyard compare`: errors and times of several estimators."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.base.arrays import by_key
from steelyard.estimate.friction.friction_choice import FrictionChoice
from steelyard.estimate.nonlinear.nonlinear_parameters import Finding
from steelyard.estimate.payload.drive_gains import GainEstimate
from steelyard.estimate.scores.estimator_comparison import Comparison, EstimatorScore, Failure
from steelyard.identify.page import gains_offsets_search_and_settings as sections
from steelyard.identify.page.friction_choice_and_curves import FrictionSection
from steelyard.report.page import Numbers, PageContent, Section, rounded, script_json
from steelyard.report.page_figures import dots, traced
from steelyard.report.tables import PlainTable, Row, light_table, table_of
from steelyard.report.words import NONE, first_names, percent, significant

LEAST_LOGARITHMIC_RATIO = 8.0  # of the largest error to the least, of a logarithmic axis

TIME_TICKS = {-5: "10 µs", -4: "0.1 ms", -3: "1 ms", -2: "10 ms", -1: "0.1 s", 0: "1 s", 1: "10 s"}


@dataclass(frozen=True, kw_only=True)
class ComparisonContent(PageContent):
    """What the page of `steelyard compare` shows."""

    comparison: Comparison
    friction: FrictionChoice | None = None  # how the friction laws were chosen, if they were
    findings: tuple[Finding, ...] = ()
    gains: GainEstimate | None = None


class CompareSection(Section, name="compare", title="Estimators compared", template="compare.html"):
    """The advice, a picture of all errors, and tables."""

    def numbers(self, content: ComparisonContent) -> Numbers:
        """Everything."""
        comparison = content.comparison
        every, parts, left = in_order(comparison), comparison.parts, comparison.left_out
        drawn = [score for score in every if score.mean is not None]
        by_joint = [Row((x.name, *(percent(float(y)) for y in x.by_joint))) for x in drawn]
        by_part = [
            Row((part, *(percent(None if x.failed[k] else float(x.means[k])) for x in drawn)))
            for k, part in enumerate(parts)
        ]
        failed = [(x.name, failure_words(x.failures, len(parts))) for x in every]
        failures = [Row((name, *words)) for name, each in failed for words in each]
        of_parts = (f"{left.capitalize()} left out", *(score.name for score in drawn))
        of_failures = ("Estimator", "When", "Reason", "What to do")
        tables = [
            main_table(comparison),
            PlainTable("Error by joint", "", ("Estimator", *comparison.joints), by_joint),
            PlainTable(f"Error by {left} left out", "", of_parts, by_part),
        ]
        if failures:
            tables.append(PlainTable("Fits that failed", "", of_failures, failures, (0, 1, 2, 3)))
        return {
            "headline": comparison_headline(comparison),
            "taken": comparison.advice is not None and bool(comparison.advice.name),
            "advice": "" if comparison.advice is None else reasons(comparison),
            "words": comparison.words,
            "stopped": stopped(comparison),
            "picture": script_json(_figure(drawn, comparison)) if drawn else None,
            "height": 110 + 34 * len(drawn),
            "tables": tables,
            "notes": [(score.name, score.notes) for score in comparison.scores if score.notes],
        }


def comparison_headline(comparison: Comparison) -> str:
    """What to take, in a few words."""
    advice = comparison.advice
    if advice is None:
        return "No estimator succeeded"
    return f"Recommended: {advice.name}" if advice.name else "No estimator is recommended"


def reasons(comparison: Comparison) -> str:
    """Why, and what to write into the robot file."""
    why = "" if comparison.advice is None else comparison.advice.why
    return why + (f". In the robot file: {comparison.setting}" if comparison.setting else "")


def stopped(comparison: Comparison) -> str:
    """What was asked for and not tried; empty if nothing."""
    if not comparison.untried:
        return ""
    total = len(comparison.scores) + len(comparison.untried)
    return (
        f"stopped: {len(comparison.scores)} of {total} estimators compared; not tried: "
        f"{', '.join(comparison.untried)}"
    )


def in_order(comparison: Comparison) -> list[EstimatorScore]:
    """The least error first, those that failed last."""
    return sorted(comparison.scores, key=lambda x: (not x.whole, inf if x.mean is None else x.mean))


def main_table(comparison: Comparison) -> PlainTable:
    """One row per estimator."""
    advice = comparison.advice
    columns: dict[str, Callable[[EstimatorScore], str]] = {
        "Estimator": lambda x: x.name,
        "Link inertias": bodies_words,
        "Error": _error_words,
        "Pooled": lambda x: percent(x.mean_pooled),
        "Time": lambda x: time_words(x.seconds),
        "Values": lambda x: NONE if x.parameters is None else str(x.parameters),
        "Condition": lambda x: significant(x.condition, 2),
        "χ²": lambda x: NONE if x.chi_square is None else f"{x.chi_square:.3f}",
    }
    return table_of(
        in_order(comparison),
        columns,
        caption="Errors on left-out data",
        words="Mean over joints and runs with its standard error; joints where they move, after "
        "the parallel filter. Pooled: norms over all joints together. Link inertias: not available "
        "from estimators of base parameters. χ²: squared residuals on all data over the noise "
        "variance by WLS, per degree of freedom.",
        text=(0, 1),
        marked=lambda x: advice is not None and x.name == advice.name,
    )


def _error_words(score: EstimatorScore) -> str:
    count, missing = len(score.failed), int(score.failed.sum())
    if missing == count:
        return "failed"
    return score.mean_text + (f" (failed {missing} of {count})" if missing else "")


def bodies_words(score: EstimatorScore) -> str:
    """Whether the bodies are physically consistent."""
    if score.impossible is None:
        return "not estimated" if score.parameters is not None else NONE
    if not score.impossible:
        return "all valid"
    return f"{first_names(score.impossible, 1)} invalid"


def time_words(seconds: float | None) -> str:
    """Like `3.2 ms`, `14 s`."""
    if seconds is None:
        return NONE
    return f"{significant(1e3 * seconds, 2)} ms" if seconds < 1.0 else f"{seconds:.3g} s"


def failure_words(failures: Sequence[Failure], parts: int) -> list[tuple[str, str, str]]:
    """When, why and what to do, once per reason; `parts` were left out in turn."""
    words = []
    found = by_key(((one.reason, one.fix), one.left_out) for one in failures)
    for (reason, fix), left in found.items():
        names = [name for name in left if name is not None]
        when = ["fitted to all data"] if None in left else []
        when += [f"without {first_names(names, 3)}"] if names else []
        words.append(("every fit" if len(left) > parts else "; ".join(when), reason, fix))
    return words


def _figure(drawn: Sequence[EstimatorScore], comparison: Comparison) -> dict[str, Any]:
    errors = np.concatenate([t.means[np.isfinite(t.means)] for t in drawn])
    wide = errors.min() > 0.0 and errors.max() > LEAST_LOGARITHMIC_RATIO * errors.min()
    names, means = [score.name for score in drawn], [score.mean or 0.0 for score in drawn]
    half = [score.standard_error or 0.0 for score in drawn]
    diamond: dict[str, Any] = {"symbol": "diamond", "size": 10, "half_widths": half}
    return {
        "x": "error [%]",
        "y": "",
        "traces": [
            traced(
                "points",
                f"one {comparison.left_out} left out",
                [rounded(float(x)) for score in drawn for x in score.means],
                [score.name for score in drawn for _ in score.means],
                marker={"size": 6, "opacity": 0.45, "color": "--arm"},
                text=[part for _ in drawn for part in comparison.parts],
                hovertemplate="%{y}, %{text}: %{x:.3g} %<extra></extra>",
            ),
            dots("mean and its standard error", means, names, "--blue", **diamond),
            traced(
                "points",
                "time of one fit",
                [None if t.seconds is None else rounded(max(t.seconds, 1e-6)) for t in drawn],
                names,
                marker={"size": 9, "symbol": "square", "color": "--vermillion"},
                xaxis="x2",
                hovertemplate="%{y}: %{x:.3g} s<extra></extra>",
            ),
        ],
        "layout": {
            "xaxis": {"domain": [0.0, 0.66], "type": "log" if wide else "linear"},
            "xaxis2": _times([t.seconds for t in drawn if t.seconds]),
            "yaxis": {"type": "category", "categoryarray": names, "autorange": "reversed"},
        },
    }


def _times(seconds: Sequence[float]) -> dict[str, Any]:
    known = np.log10(np.maximum(seconds, 1e-6)) if seconds else np.zeros(1)
    first, last = int(np.floor(known.min())), int(np.ceil(known.max() + 1e-9))
    ticks = range(first, last + 1)
    return {
        "domain": [0.72, 1.0],
        "type": "log",
        "title": {"text": "time", "standoff": 6},
        "range": [first - 0.1, last + 0.1],
        "tickvals": [10.0**k for k in ticks],
        "ticktext": [TIME_TICKS.get(k, f"{10.0**k:g} s") for k in ticks],
    }


TERMINAL_COLUMNS: tuple[int, ...] = (0, 1, 2, 4, 7)  # of the main table
MOST_SHOWN_ESTIMATORS = 10  # the best; with `--verbose` all
CONDITION_COLUMN = 6  # the column that is shown where the condition numbers differ
EQUAL_CONDITION_SHARE = 0.8  # of rows with one condition number: says nothing

COLUMN_MEANINGS = {
    "Condition": "condition number of the whitened regressor, columns of unit length",
    "χ²": "squared residuals over the noise variance by WLS, per degree of freedom: about 1 for "
    "WLS; an excess is due to constraints, a prior or other weights",
}


def comparison_lines(content: ComparisonContent, console: Console, verbose: bool = False) -> None:
    """Print the recommendation with its reason, the table, and what failed."""
    comparison = content.comparison
    console.print(Text(comparison_headline(comparison), style="bold"))
    advice = comparison.advice
    if advice is not None:
        about = [f"{s.name}: {s.about}" for s in comparison.scores if s.name == advice.name]
        for line in (*about, advice.why):
            console.print(Text(line))
    if comparison.setting:
        console.print(Text(f"in the robot file: {comparison.setting}"))
    if left := stopped(comparison):
        console.print(Text(left, style="bold yellow"))
    console.print()
    shown = main_table(comparison)
    most = len(shown.rows) if verbose else MOST_SHOWN_ESTIMATORS
    known = [x for row in shown.rows if (x := row.cells[CONDITION_COLUMN]) != NONE]
    columns, same = TERMINAL_COLUMNS, max((known.count(cell) for cell in known), default=0)
    if same < EQUAL_CONDITION_SHARE * len(known):
        columns = tuple(sorted((*columns, CONDITION_COLUMN)))
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
    for heading in (shown.headings[number] for number in columns if verbose):
        if heading in COLUMN_MEANINGS:
            console.print(Text(f"{heading}: {COLUMN_MEANINGS[heading]}"))
    for score in in_order(comparison):
        for when, reason, fix in failure_words(score.failures, len(comparison.parts)):
            console.print(Text(f"{score.name} failed ({when}): {reason}; {fix}", style="yellow"))
    for note in (*content.notes, *(content.details if verbose else ())):
        console.print(Text(f"note: {note}"))


COMPARE_SECTIONS: tuple[Section, ...] = (
    CompareSection(),
    FrictionSection(),
    sections.DrivesSection(),
    sections.QualitySection(),
    sections.SettingsSection(),
)
