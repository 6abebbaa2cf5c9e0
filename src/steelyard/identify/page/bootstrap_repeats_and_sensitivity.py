"""Sections of how estimates differ: bootstrap, each log alone, other cut-offs."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from steelyard.base.arrays import Array
from steelyard.estimate.parameter_status_bootstrap_and_sensitivity import (
    Bootstrap,
    RepeatedEstimates,
    Sensitivity,
    Variation,
)
from steelyard.identify.page.report_content import ReportContent
from steelyard.report.page import ValueSection
from steelyard.report.tables import PlainTable, Row, table_of, text_table
from steelyard.report.words import count, percent, significant

MOST_NAMED_SCATTERS = 3  # in the terminal
LEAST_MARKED_RATIO = 2.0  # ratio of the two standard deviations from which on a row is marked


class BootstrapSection(
    ValueSection, name="bootstrap", title="Bootstrap over time windows", value="bootstrap"
):
    """Stated and drawn standard deviations of every parameter."""

    def tables_of(self, found: Bootstrap, content: ReportContent) -> Sequence[PlainTable]:
        """One row per parameter; those that scatter far more than was stated are marked."""
        return (_bootstrap_table(found, content.identified.estimate.std),)

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """How the scatter of drawn windows compares with the stated uncertainty."""
        found = content.bootstrap
        if found is None:
            return
        over, names = _ratios(found, content.identified.estimate.std), found.parameters.names
        order = np.argsort(-np.nan_to_num(over))[:MOST_NAMED_SCATTERS]
        most = ", ".join(f"{names[k]} {significant(float(over[k]))}" for k in order)
        lines = [
            f"bootstrap: {len(found.draws)} draws of {count(found.windows, 'window')} scatter by "
            f"{significant(float(np.nanmedian(over)))} of the stated standard deviation in the "
            "median",
            f"largest ratios: {most}; {int(np.sum(over > LEAST_MARKED_RATIO))} of {len(over)} "
            f"above {LEAST_MARKED_RATIO:g}",
        ]
        if found.failed:
            lines.append(f"{count(found.failed, 'draw')} gave no estimate")
        yield Text("\n".join(lines))


def _ratios(found: Bootstrap, stated: Array) -> Array:
    """Scatter of each parameter over its stated standard deviation, shape `(p,)`."""
    unknown = np.full(len(stated), np.nan)
    return np.asarray(np.divide(found.std, stated, out=unknown, where=stated > 0.0))


def _bootstrap_table(found: Bootstrap, stated: Array) -> PlainTable:
    own, over = found.parameters, _ratios(found, stated)
    columns = np.column_stack([own.values, stated, found.std, over, *found.interval()])
    rows = [
        Row((name, *map(significant, numbers), unit), bool(ratio > LEAST_MARKED_RATIO))
        for name, unit, numbers, ratio in zip(
            own.names, own.units, columns.tolist(), over, strict=True
        )
    ]
    failed = f" {found.failed} draws gave no estimate." if found.failed else ""
    return PlainTable(
        f"{len(found.draws)} draws of {found.windows} windows",
        "Windows of every run are resampled with replacement, and the whole estimate is repeated."
        f"{failed} Where its scatter exceeds {LEAST_MARKED_RATIO:g} times the stated std (bold), "
        "windows disagree, so the model is incomplete there, or a body lies at the boundary of "
        "physical consistency, where the stated interval is too narrow. Parameters constrained by "
        "the prior scatter less than their uncertainty.",
        ("Parameter", "Value", "Stated std", "Bootstrap std", "Ratio", "2.5 %", "97.5 %", "Unit"),
        rows,
        (0, 7),
    )


REPEATED_TITLE = "Estimates from each log alone"


class RepeatedSection(ValueSection, name="repeated", title=REPEATED_TITLE, value="repeated"):
    """Mean and standard deviation of every parameter over the logs."""

    def tables_of(self, found: RepeatedEstimates, content: ReportContent) -> Sequence[PlainTable]:
        """One row per parameter."""
        return (repeated_table(found),)

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The table, as it was asked for."""
        for table in self.tables(content):
            yield text_table(table, self.title)


def repeated_table(found: RepeatedEstimates) -> PlainTable:
    """One row per parameter; a parameter that some estimations do not identify has their number."""
    every = len(found.labels)

    def name(row: Mapping[str, Any]) -> str:
        known: str = row["name"]
        return known if row["count"] == every else f"{known} ({row['count']} of {every})"

    return table_of(
        found.rows(),
        {
            "Parameter": name,
            "Mean": lambda row: significant(row["mean"]),
            "Std": lambda row: significant(row["std"]),
            "Relative": lambda row: percent(row["relative_percent"]),
            "Stated std": lambda row: significant(row["stated_std"]),
            "Unit": lambda row: str(row["unit"]),
        },
        caption=f"{REPEATED_TITLE}: {count(every, 'estimation')}",
        words=f"Mean and {found.deviation} standard deviation over {', '.join(found.labels)}, "
        "beside the root mean square of the stated standard deviations. A prior that all "
        "estimations share reduces their scatter.",
        text=(0, 5),
        note=f"std: {found.deviation}; relative: over the mean; stated std: root mean square of "
        "those stated by the estimations",
    )


MOST_NAMED_MOVES = 10  # parameters that are named: those that move most


class SensitivitySection(
    ValueSection, name="sensitivity", title="Sensitivity to the cut-offs", value="sensitivity"
):
    """Fits with other cut-offs, and the parameters that move most between them."""

    def tables_of(self, found: Sensitivity, content: ReportContent) -> Sequence[PlainTable]:
        """The fits, and the parameters that move most."""
        return _fits_table(found), _moved(found)

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The fits, and which parameters move most between them."""
        found = content.sensitivity
        if found is None:
            return

        yield text_table(_fits_table(found), self.title)
        order = np.argsort(-found.spread)[:MOST_NAMED_MOVES]
        most = ", ".join(f"{found.parameters.names[k]} {found.spread[k]:.1f}" for k in order)
        yield Text(f"largest parameter shifts, in standard deviations: {most}")


def _fits_table(found: Sensitivity) -> PlainTable:
    """One row per fit."""

    def shift(fit: Variation) -> str:
        median = found.median_shift(fit)
        return "" if median is None else significant(median)

    return table_of(
        found.rows,
        {
            "Cut-offs": lambda fit: f"x {fit.factor:g}",
            "Motion": lambda fit: f"{fit.motion:g} Hz",
            "Regression": lambda fit: f"{fit.matched:g} Hz",
            "Fit error": lambda fit: fit.failed or _percent(fit.fitted),
            "Validation error": lambda fit: _percent(fit.unseen),
            "Median shift [std]": shift,
        },
        caption="Fits with other cut-offs",
        words="The same laws, nonlinear parameters and gains; errors are of the kind and the band "
        "of the verdict's headline in every row. A result that other cut-offs change by many "
        "standard deviations depends on the choice of cut-offs, not on the data alone.",
        marked=lambda fit: fit is found.result,
    )


def _moved(found: Sensitivity) -> PlainTable:
    names, spread = found.parameters.names, found.spread
    return table_of(
        np.argsort(-spread)[:MOST_NAMED_MOVES].tolist(),
        {
            "Parameter": lambda k: names[k],
            "Largest shift [std]": lambda k: significant(float(spread[k])),
        },
        caption="Largest parameter shifts",
        words="Largest distance of any of these fits from the result, in standard deviations.",
    )


def _percent(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} %"
