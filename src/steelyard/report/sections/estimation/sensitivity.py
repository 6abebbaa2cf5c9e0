"""How much the result hangs on the cut-offs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.report.content import ReportContent
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row, text_table
from steelyard.report.text.words import significant
from steelyard.validation.sensitivity import Sensitivity

if TYPE_CHECKING:
    from rich.console import RenderableType

NAMED = 3
"""Parameters that the terminal names."""

NAMED = 10
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
        order = np.argsort(-found.spread)[:NAMED]
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
    order = np.argsort(-found.spread)[:NAMED]
    rows = [Row((found.parameters.names[k], significant(float(found.spread[k])))) for k in order]
    return PlainTable(
        "Largest parameter shifts",
        "Largest distance of any of these fits from the result, in standard deviations.",
        ("Parameter", "Largest shift [std]"),
        rows,
    )


def _percent(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} %"
