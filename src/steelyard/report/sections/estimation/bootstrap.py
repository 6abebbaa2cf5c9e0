"""How the estimate scatters when windows of time are drawn again, beside what was stated."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.report.content import ReportContent
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import count, significant

if TYPE_CHECKING:
    from rich.console import RenderableType

NAMED = 3
"""Parameters that the terminal names: those that scatter most beside what was stated."""

FAR = 2.0
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
        order = np.argsort(-np.nan_to_num(over))[:NAMED]
        most = ", ".join(f"{names[k]} {significant(float(over[k]))}" for k in order)
        lines = [
            f"bootstrap: {len(found.draws)} draws of {count(found.windows, 'window')} scatter by "
            f"{significant(float(np.nanmedian(over)))} of the stated standard deviation in the "
            "median",
            f"largest ratios: {most}; {int(np.sum(over > FAR))} of {len(over)} above {FAR:g}",
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
        rows.append(Row(cells, bool(over[k] > FAR)))
    failed = f" {found.failed} draws gave no estimate." if found.failed else ""
    return PlainTable(
        f"{len(found.draws)} draws of {found.windows} windows",
        "Windows of every run are resampled with replacement, and the whole estimate is repeated."
        f"{failed} Where its scatter exceeds {FAR:g} times the stated std (bold), windows "
        "disagree, so the model is incomplete there, or a body lies at the boundary of physical "
        "consistency, where the stated interval is too narrow. Parameters constrained by the prior "
        "scatter less than their uncertainty.",
        ("Parameter", "Value", "Stated std", "Bootstrap std", "Ratio", "2.5 %", "97.5 %", "Unit"),
        rows,
        (0, 7),
    )
