"""Scatter of estimates: bootstrap, each log alone, other cut-off frequencies."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.estimate_scatter import Sensitivity
from steelyard.identify.page.content import ReportContent
from steelyard.report.page import TableSection
from steelyard.report.tables import PlainTable, Row, text_table
from steelyard.report.words import count, percent, significant

if TYPE_CHECKING:
    from rich.console import RenderableType

    from steelyard.estimate.estimate_scatter import RepeatedEstimates


MOST_NAMED_SCATTERS = 3
"""Parameters that the terminal names: those that scatter most beside what was stated."""

LEAST_MARKED_RATIO = 2.0
"""Ratio of the two standard deviations from which on a row is marked."""


class BootstrapSection(TableSection):
    """Stated and drawn standard deviations of every parameter."""

    name: ClassVar[str] = "bootstrap"
    title: ClassVar[str] = "Bootstrap over time windows"

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if it was asked for."""
        asked = content.bootstrap is not None and content.identified is not None
        return [scatter_table(content)] if asked else []

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The scatter."""
        return {"bootstrap": None if content.bootstrap is None else content.bootstrap.to_dict()}

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """How the scatter of drawn windows compares with the stated uncertainty."""
        found = content.bootstrap
        if found is None:
            return
        from rich.text import Text

        over = ratios(content)
        names = found.parameters.names
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


def ratios(content: ReportContent) -> Array:
    """Scatter of each parameter over its stated standard deviation, shape `(p,)`."""
    if content.bootstrap is None or content.identified is None:
        raise ValueError("there is no bootstrap to show")
    stated = content.identified.estimate.std
    drawn = content.bootstrap.std
    return np.asarray(np.divide(drawn, stated, out=np.full(len(drawn), np.nan), where=stated > 0.0))


def scatter_table(content: ReportContent) -> PlainTable:
    """One row per parameter; those that scatter far more than was stated are marked."""
    found, identified = content.bootstrap, content.identified
    if found is None or identified is None:
        raise ValueError("there is no bootstrap to show")
    lower, upper = found.interval()
    own = found.parameters
    stated, drawn, over = identified.estimate.std, found.std, ratios(content)
    rows = []
    for k, (name, unit) in enumerate(zip(own.names, own.units, strict=True)):
        numbers = (own.values[k], stated[k], drawn[k], over[k], lower[k], upper[k])
        cells = (name, *(significant(float(x)) for x in numbers), unit)
        rows.append(Row(cells, bool(over[k] > LEAST_MARKED_RATIO)))
    failed = f" {found.failed} draws gave no estimate." if found.failed else ""
    return PlainTable(
        f"{len(found.draws)} draws of {found.windows} windows",
        "Windows of every run are resampled with replacement, and the whole estimate is repeated."
        f"{failed} Where its scatter exceeds {LEAST_MARKED_RATIO:g} times the stated std "
        "(bold), windows "
        "disagree, so the model is incomplete there, or a body lies at the boundary of physical "
        "consistency, where the stated interval is too narrow. Parameters constrained by the prior "
        "scatter less than their uncertainty.",
        ("Parameter", "Value", "Stated std", "Bootstrap std", "Ratio", "2.5 %", "97.5 %", "Unit"),
        rows,
        (0, 7),
    )


REPEATED_TITLE = "Estimates from each log alone"


class RepeatedSection(TableSection):
    """Mean and standard deviation of every parameter over the logs."""

    name: ClassVar[str] = "repeated"
    title: ClassVar[str] = REPEATED_TITLE

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """One table, if it was asked for."""
        return [] if content.repeated is None else [repeated_table(content.repeated)]

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The estimates and their scatter."""
        return {"repeated": None if content.repeated is None else content.repeated.to_dict()}

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The table, as it was asked for."""
        for table in self.tables(content):
            yield text_table(table, self.title)


def repeated_table(found: RepeatedEstimates) -> PlainTable:
    """One row per parameter; a parameter that some estimations do not identify has their number."""
    every = len(found.labels)
    rows = [
        Row(
            (
                row["name"] + ("" if row["count"] == every else f" ({row['count']} of {every})"),
                *(significant(row[key]) for key in ("mean", "std")),
                percent(row["relative_percent"]),
                significant(row["stated_std"]),
                row["unit"],
            )
        )
        for row in found.rows()
    ]
    return PlainTable(
        f"{REPEATED_TITLE}: {count(every, 'estimation')}",
        f"Mean and {found.deviation} standard deviation over {', '.join(found.labels)}, beside the "
        "root mean square of the stated standard deviations. A prior that all estimations share "
        "reduces their scatter.",
        ("Parameter", "Mean", "Std", "Relative", "Stated std", "Unit"),
        rows,
        (0, 5),
        f"std: {found.deviation}; relative: over the mean; stated std: root mean square of those "
        "stated by the estimations",
    )


MOST_NAMED_MOVES = 3
"""Parameters that the terminal names."""

MOST_NAMED_MOVES = 10
"""Parameters that are named: those that move most."""


class SensitivitySection(TableSection):
    """Fits with other cut-offs, and the parameters that move most between them."""

    name: ClassVar[str] = "sensitivity"
    title: ClassVar[str] = "Sensitivity to the cut-offs"

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """Two tables, if it was asked for."""
        found = content.sensitivity
        return [] if found is None else [fits_table(found), _moved(found)]

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The fits."""
        found = content.sensitivity
        return {"sensitivity": None if found is None else found.to_dict()}

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The fits, and which parameters move most between them."""
        found = content.sensitivity
        if found is None:
            return
        from rich.text import Text

        yield text_table(fits_table(found), self.title)
        order = np.argsort(-found.spread)[:MOST_NAMED_MOVES]
        most = ", ".join(f"{found.parameters.names[k]} {found.spread[k]:.1f}" for k in order)
        yield Text(f"largest parameter shifts, in standard deviations: {most}")


def fits_table(found: Sensitivity) -> PlainTable:
    """One row per fit."""
    rows = []
    for v in found.rows:
        shift = "" if v.values is None else significant(float(np.median(found.shift(v))))
        cells = (
            f"x {v.factor:g}",
            f"{v.motion:g} Hz",
            f"{v.matched:g} Hz",
            v.failed or _percent(v.fitted),
            _percent(v.unseen),
            shift,
        )
        rows.append(Row(cells, v is found.result))
    return PlainTable(
        "Fits with other cut-offs",
        "The same laws, nonlinear parameters and gains; errors are of the kind and the band of the "
        "verdict's headline in every row. A result that other cut-offs change by many standard "
        "deviations depends on the choice of cut-offs, not on the data alone.",
        (
            "Cut-offs",
            "Motion",
            "Regression",
            "Fit error",
            "Validation error",
            "Median shift [std]",
        ),
        rows,
    )


def _moved(found: Sensitivity) -> PlainTable:
    order = np.argsort(-found.spread)[:MOST_NAMED_MOVES]
    rows = [Row((found.parameters.names[k], significant(float(found.spread[k])))) for k in order]
    return PlainTable(
        "Largest parameter shifts",
        "Largest distance of any of these fits from the result, in standard deviations.",
        ("Parameter", "Largest shift [std]"),
        rows,
    )


def _percent(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} %"
